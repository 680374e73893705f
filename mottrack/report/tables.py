"""The figures of the runs as rows of cells, the best ones marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mottrack.eval.flow_error import FlowError
from mottrack.eval.nuscenes.anatomy_report import ClassAnatomy
from mottrack.eval.scores import ClassScores
from mottrack.eval.velocity_error import NO_ROWS
from mottrack.report.contest import Cell, Entrant, best_of
from mottrack.report.measures import FLOW, TRACKING, VELOCITY, Measure

NAN = float("nan")
LEADING_VELOCITY_ROWS = 6
LEADING_FLOW_ROWS = 7


@dataclass(frozen=True)
class Row:
    """A line of a table."""

    name: str
    cells: tuple[Cell, ...]
    entrant: Entrant | None = None
    """The run, where the line is a run's."""


@dataclass(frozen=True)
class Block:
    """Lines under a heading of their own; the first block of a table has none."""

    heading: str
    rows: tuple[Row, ...]


def tracking_blocks(entrants: Sequence[Entrant]) -> list[Block]:
    """A line a run: all classes together, then class by class."""
    labels = dict.fromkeys(label for e in entrants for label in e.run.scores.classes)
    overall = [e.run.scores.overall for e in entrants]
    blocks = [Block("", _tracking_rows(entrants, overall))]
    for label in labels:
        parts = [e.run.scores.classes.get(label) for e in entrants]
        if any(part is not None and part.clear.truth for part in parts):
            blocks.append(Block(label, _tracking_rows(entrants, parts)))
    return blocks


def _tracking_rows(
    entrants: Sequence[Entrant], parts: Sequence[ClassScores | None]
) -> tuple[Row, ...]:
    figures = [{} if part is None else part.as_dict() for part in parts]
    columns = [_column(measure, figures, entrants) for measure in TRACKING]
    return tuple(
        Row(entrant.title, tuple(column[k] for column in columns), entrant)
        for k, entrant in enumerate(entrants)
    )


def _column(
    measure: Measure, figures: Sequence[Mapping[str, float]], entrants: Sequence[Entrant]
) -> list[Cell]:
    values = [figure.get(measure.key, NAN) for figure in figures]
    best = best_of(measure, values, entrants)
    return [Cell(measure.text(v), b) for v, b in zip(values, best, strict=True)]


def velocity_blocks(entrants: Sequence[Entrant]) -> list[Block]:
    """A line a category, two columns a run; the classes of the objects below."""
    names = list(dict.fromkeys(row for e in entrants for row in e.run.scores.velocity))
    rows = [_velocity_row(name, entrants) for name in names]
    return _blocks(rows, LEADING_VELOCITY_ROWS, "by class of the object")


def _velocity_row(name: str, entrants: Sequence[Entrant]) -> Row:
    errors = [e.run.scores.velocity.get(name, NO_ROWS) for e in entrants]
    mean, worst = (
        best_of(measure, [getattr(error, measure.key) for error in errors], entrants)
        for measure in VELOCITY
    )
    cells = []
    for k, error in enumerate(errors):
        cells.append(Cell(VELOCITY[0].text(error.mean_mps), mean[k], f"{error.count} rows"))
        cells.append(Cell(VELOCITY[1].text(error.worst_mean_mps), worst[k]))
    return Row(name, tuple(cells))


def flow_blocks(entrants: Sequence[Entrant]) -> list[Block]:
    """A line a kind of cell, three columns a run; by speed and by range below."""
    names = list(dict.fromkeys(row for e in entrants for row in e.run.scores.flow))
    rows = [_flow_row(name, entrants) for name in names]
    return _blocks(rows, LEADING_FLOW_ROWS, "by true speed and by range")


def _flow_row(name: str, entrants: Sequence[Entrant]) -> Row:
    nothing = FlowError(0, *(6 * [NAN]))
    errors = [e.run.scores.flow.get(name, nothing) for e in entrants]
    best = [best_of(m, [getattr(error, m.key) for error in errors], entrants) for m in FLOW]
    cells = [
        Cell(measure.text(getattr(error, measure.key)), best[j][k])
        for k, error in enumerate(errors)
        for j, measure in enumerate(FLOW)
    ]
    return Row(name, tuple(cells))


def _blocks(rows: Sequence[Row], leading: int, heading: str) -> list[Block]:
    blocks = [Block("", tuple(rows[:leading])), Block(heading, tuple(rows[leading:]))]
    return [block for block in blocks if block.rows]


def gain_rows(
    entrants: Sequence[Entrant], anatomies: Sequence[Mapping[str, ClassAnatomy]]
) -> list[Row]:
    """AMOTA that each run would gain without the errors of each kind."""
    gains = [_gains(e, anatomy) for e, anatomy in zip(entrants, anatomies, strict=True)]
    kinds = dict.fromkeys(kind for gain in gains for kind in gain)
    return [Row(k, tuple(Cell(f"+{gain.get(k, 0.0):.3f}") for gain in gains)) for k in kinds]


def _gains(entrant: Entrant, anatomy: Mapping[str, ClassAnatomy]) -> dict[str, float]:
    """AMOTA is a mean over the classes that have truth, so a gain in one is shared by all."""
    classes = sum(part.amota == part.amota for part in entrant.run.scores.classes.values())
    gains: dict[str, float] = {}
    for part in anatomy.values():
        for kind, amota in part.amota_without.items():
            gains[kind] = gains.get(kind, 0.0) + (amota - part.amota) / max(classes, 1)
    return gains

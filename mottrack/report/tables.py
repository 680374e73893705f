"""The figures of the runs as rows of cells, the best ones marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mottrack.eval.flow_error import FlowError
from mottrack.eval.nuscenes.error_classes import ClassErrors
from mottrack.eval.scores import ClassScores
from mottrack.eval.velocity_error import NO_ROWS, ErrorRow
from mottrack.report.measures import FLOW, TRACKING, VELOCITY, Measure
from mottrack.report.ranking import Cell, ReportRun, best_of

NAN = float("nan")
LEADING_VELOCITY_ROWS = 6
LEADING_FLOW_ROWS = 7


@dataclass(frozen=True)
class Row:
    """A line of a table."""

    name: str
    cells: tuple[Cell, ...]
    entrant: ReportRun | None = None
    """The run, where the line is a run's."""


@dataclass(frozen=True)
class Block:
    """Lines under a heading of their own; the first block of a table has none."""

    heading: str
    rows: tuple[Row, ...]


def tracking_blocks(entrants: Sequence[ReportRun]) -> list[Block]:
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
    entrants: Sequence[ReportRun], parts: Sequence[ClassScores | None]
) -> tuple[Row, ...]:
    figures = [{} if part is None else part.as_dict() for part in parts]
    columns = [_column(measure, figures, entrants) for measure in TRACKING]
    return tuple(
        Row(entrant.title, tuple(column[k] for column in columns), entrant)
        for k, entrant in enumerate(entrants)
    )


def _column(
    measure: Measure, figures: Sequence[Mapping[str, float]], entrants: Sequence[ReportRun]
) -> list[Cell]:
    values = [figure.get(measure.key, NAN) for figure in figures]
    best = best_of(measure, values, entrants)
    return [Cell(measure.text(v), b) for v, b in zip(values, best, strict=True)]


def velocity_blocks(entrants: Sequence[ReportRun]) -> list[Block]:
    """A line a category, a column a run; the classes of the objects below."""
    names = list(dict.fromkeys(row for e in entrants for row in e.run.scores.velocity))
    rows = [_velocity_row(name, entrants) for name in names]
    return _blocks(rows, LEADING_VELOCITY_ROWS, "by class of the object")


def _velocity_row(name: str, entrants: Sequence[ReportRun]) -> Row:
    errors = [e.run.scores.velocity.get(name, NO_ROWS) for e in entrants]
    cells = _stacked_cells(VELOCITY, errors, entrants)
    with_counts = [
        replace(cell, under=(*cell.under, (f"{error.count} rows", False)))
        for cell, error in zip(cells, errors, strict=True)
    ]
    return Row(name, tuple(with_counts))


def flow_blocks(entrants: Sequence[ReportRun]) -> list[Block]:
    """A line a kind of cell, a column a run; by speed and by range below."""
    nothing = FlowError(0, *(6 * [NAN]))
    names = list(dict.fromkeys(row for e in entrants for row in e.run.scores.flow))
    rows = []
    for name in names:
        errors = [e.run.scores.flow.get(name, nothing) for e in entrants]
        rows.append(Row(name, tuple(_stacked_cells(FLOW, errors, entrants))))
    return _blocks(rows, LEADING_FLOW_ROWS, "by true speed and by range")


def _stacked_cells(
    measures: Sequence[Measure],
    errors: Sequence[ErrorRow] | Sequence[FlowError],
    entrants: Sequence[ReportRun],
) -> list[Cell]:
    """A cell a run: the first measure large, the others small below it."""
    columns = []
    for measure in measures:
        values = [float(getattr(error, measure.key)) for error in errors]
        best = best_of(measure, values, entrants)
        columns.append([(measure.text(v), b) for v, b in zip(values, best, strict=True)])
    first, *others = columns
    return [
        Cell(text, best, tuple(other[k] for other in others))
        for k, (text, best) in enumerate(first)
    ]


def _blocks(rows: Sequence[Row], leading: int, heading: str) -> list[Block]:
    blocks = [Block("", tuple(rows[:leading])), Block(heading, tuple(rows[leading:]))]
    return [block for block in blocks if block.rows]


def gain_rows(
    entrants: Sequence[ReportRun], anatomies: Sequence[Mapping[str, ClassErrors]]
) -> list[Row]:
    """AMOTA that each run would gain without the errors of each kind."""
    gains = [_gains(e, anatomy) for e, anatomy in zip(entrants, anatomies, strict=True)]
    kinds = dict.fromkeys(kind for gain in gains for kind in gain)
    return [Row(k, tuple(Cell(f"+{gain.get(k, 0.0):.3f}") for gain in gains)) for k in kinds]


def _gains(entrant: ReportRun, anatomy: Mapping[str, ClassErrors]) -> dict[str, float]:
    """AMOTA is a mean over the classes that have truth, so a gain in one is shared by all."""
    classes = sum(part.amota == part.amota for part in entrant.run.scores.classes.values())
    gains: dict[str, float] = {}
    for part in anatomy.values():
        for kind, amota in part.amota_without.items():
            gains[kind] = gains.get(kind, 0.0) + (amota - part.amota) / max(classes, 1)
    return gains

"""Tables of tracking, velocity and flow metrics; significant differences are marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

from mottrack.eval.flow_error import FlowError
from mottrack.eval.metric_info import FLOW, TRACKING, VELOCITY, MetricInfo
from mottrack.eval.nuscenes.error_counts import ClassErrors
from mottrack.eval.paired import MetricKey
from mottrack.eval.scores import ClassScores
from mottrack.eval.velocity_error import CATEGORIES, ErrorRow
from mottrack.report.ranking import NAN, Cell, ReportRun, Verdicts, marked_cells

LEADING_VELOCITY_ROWS = len(CATEGORIES) + 1
"""Rows before those by object class: the categories and "all"."""
LEADING_FLOW_ROWS = 7
"""Rows of eval.flow_error.flow_table before those by speed and by range."""


@dataclass(frozen=True)
class Row:
    """A line of a table."""

    name: str
    cells: tuple[Cell, ...]
    run: ReportRun | None = None
    """The run that the line belongs to; None where runs are columns."""


@dataclass(frozen=True)
class Block:
    """Lines under a common heading; the first block of a table has none."""

    heading: str
    rows: tuple[Row, ...]


TRACKING_KEYS = {
    "amota": "AMOTA",
    "amotp_m": "AMOTP",
    "mota": "MOTA",
    "motp_m": "MOTP",
    "id_switches": "IDS",
}
"""Metrics of all classes whose differences are tested, by their names in the table."""
TESTED = {"mean_mps": "mean", "worst_mean_mps": "worst 5 %", "rmse_mps": "RMSE"}
"""Likewise of velocity and flow."""


def tracking_blocks(runs: Sequence[ReportRun], verdicts: Verdicts) -> list[Block]:
    """Return one row per run, of all classes together and then of each class with truth."""
    labels = dict.fromkeys(label for run in runs for label in run.scored.scores.classes)
    overall = [run.scored.scores.overall for run in runs]
    blocks = [Block("", _tracking_rows(runs, overall, verdicts))]
    for label in labels:
        parts = [run.scored.scores.classes.get(label) for run in runs]
        if any(part is not None and part.clear.truth for part in parts):
            blocks.append(Block(label, _tracking_rows(runs, parts, Verdicts())))
    return blocks


def _tracking_rows(
    runs: Sequence[ReportRun], parts: Sequence[ClassScores | None], verdicts: Verdicts
) -> tuple[Row, ...]:
    values = [{} if part is None else part.as_dict() for part in parts]
    columns = [
        marked_cells(info, _values(info, values), runs, verdicts, _tracking_key(info))
        for info in TRACKING
    ]
    return tuple(
        Row(run.title, cells, run)
        for run, cells in zip(runs, zip(*columns, strict=True), strict=True)
    )


def _tracking_key(info: MetricInfo) -> MetricKey | None:
    name = TRACKING_KEYS.get(info.key)
    return None if name is None else MetricKey("tracking", "all", name)


def _values(info: MetricInfo, values: Sequence[Mapping[str, float]]) -> list[float]:
    return [v.get(info.key, NAN) for v in values]


def velocity_blocks(runs: Sequence[ReportRun], verdicts: Verdicts) -> list[Block]:
    """Return one row per category and one column per run; rows by object class come last."""
    tables = [run.scored.scores.velocity for run in runs]
    rows = []
    for row in _category_rows("velocity", tables, runs, verdicts):
        counts = [table[row.name].count if row.name in table else 0 for table in tables]
        cells = [
            replace(cell, under=(*cell.under, Cell(f"{count} rows")))
            for cell, count in zip(row.cells, counts, strict=True)
        ]
        rows.append(replace(row, cells=tuple(cells)))
    return _blocks(rows, LEADING_VELOCITY_ROWS, "by object class")


def flow_blocks(runs: Sequence[ReportRun], verdicts: Verdicts) -> list[Block]:
    """Return one row per set of cells and one column per run; speeds and ranges come last."""
    rows = _category_rows("flow", [run.scored.scores.flow for run in runs], runs, verdicts)
    return _blocks(rows, LEADING_FLOW_ROWS, "by true speed and by range")


def _category_rows(
    table: str,
    parts: Sequence[Mapping[str, ErrorRow] | Mapping[str, FlowError]],
    runs: Sequence[ReportRun],
    verdicts: Verdicts,
) -> list[Row]:
    """Return rows of one cell per run: the first metric, the others small below it."""
    rows = []
    for name in dict.fromkeys(name for part in parts for name in part):
        errors = [asdict(part[name]) if name in part else {} for part in parts]
        first, *others = [
            marked_cells(info, _values(info, errors), runs, verdicts, _key(table, name, info))
            for info in {"velocity": VELOCITY, "flow": FLOW}[table]
        ]
        under = zip(*others, strict=True)
        cells = (replace(cell, under=small) for cell, small in zip(first, under, strict=True))
        rows.append(Row(name, tuple(cells)))
    return rows


def _key(table: str, row: str, info: MetricInfo) -> MetricKey | None:
    return MetricKey(table, row, TESTED[info.key]) if info.key in TESTED else None


def _blocks(rows: Sequence[Row], leading: int, heading: str) -> list[Block]:
    blocks = [Block("", tuple(rows[:leading])), Block(heading, tuple(rows[leading:]))]
    return [block for block in blocks if block.rows]


def gain_rows(runs: Sequence[ReportRun], per_run: Sequence[Mapping[str, ClassErrors]]) -> list[Row]:
    """Return the AMOTA that each run would gain without the errors of each type."""
    gains = [_gains(run, error_classes) for run, error_classes in zip(runs, per_run, strict=True)]
    kinds = dict.fromkeys(kind for gain in gains for kind in gain)
    return [Row(k, tuple(Cell(f"+{gain.get(k, 0.0):.3f}") for gain in gains)) for k in kinds]


def _gains(run: ReportRun, error_classes: Mapping[str, ClassErrors]) -> dict[str, float]:
    """AMOTA is a mean over the classes with truth, so a gain in one is divided by their number."""
    classes = sum(part.amota == part.amota for part in run.scored.scores.classes.values())
    gains: dict[str, float] = {}
    for part in error_classes.values():
        for kind, amota in part.amota_without.items():
            gains[kind] = gains.get(kind, 0.0) + (amota - part.amota) / max(classes, 1)
    return gains

"""The few tables of a comparison that the terminal shows: a run in each row, main figures only."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from mottrack.eval import label_free
from mottrack.eval.paired import MetricKey, PairedDifference, whole
from mottrack.eval.velocity_error import CATEGORIES
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.pipeline.latency import ORDER, TOTAL
from mottrack.runs.comparison import Comparison
from mottrack.runs.comparison_tables import significance
from mottrack.runs.differences import RunDifferences
from mottrack.runs.label_free import judgements
from mottrack.runs.scored_run import ScoredRun

UNLABELLED, VULNERABLE, STATIONARY, SLOW, FAST = CATEGORIES
SHORT = {
    MetricKey("velocity", "all", "mean"): "velocity error, m/s",
    MetricKey("velocity", FAST, "mean"): "velocity error of fast objects",
    MetricKey("velocity", UNLABELLED, "mean"): "velocity error, unlabelled",
    MetricKey("flow", "dynamic", "RMSE"): "flow RMSE, dynamic cells, m/s",
    label_free.ERROR: "flow error without labels, m/s",
    MetricKey("tracking", "all", "AMOTA"): "AMOTA",
    MetricKey("tracking", "all", "MOTA"): "MOTA",
    MetricKey("tracking", "all", "IDS"): "identity switches",
}
"""The differences that the terminal shows, and their names there."""
METHOD = (
    "± is half the 95 % interval of the paired difference over resampled scenes; about 1 in 20 "
    "null differences is called significant"
)
RANKS = "rank by the error: no flow has the largest residual of what moves, none of what rests"
ONE_SCENE = "one scene: no interval, so no difference is known to be significant"
LATENCY = (
    "of steps in which every stage ran, without reading files; late: steps over the {budget} "
    "between two sweeps; warm-up: loading and compiling"
)


def summary_tables(comparison: Comparison) -> list[TextTable]:
    """Return the main tables; velocity and flow come first where clusters are tracked.

    Runs of equal tracks are shown once.
    """
    runs = [run for run in comparison.runs if run.finished]
    if not runs:
        return []
    different = [run for run in runs if run.title not in comparison.equal]
    tracking, velocity, flow = _tracking(different), _velocity(different), _flow(runs)
    clusters = all(run.scores.overall.amota != run.scores.overall.amota for run in runs)
    scored = [velocity, flow, tracking] if clusters else [tracking, velocity, flow]
    parts = [part for part in comparison.differences if part.run not in comparison.equal]
    if not any(run.has_truth for run in runs):
        scored, parts = [], [_unlabelled(part) for part in parts]
    tables = [*scored, _label_free(runs), _latency(runs), *_differences(parts)]
    return [table for table in tables if table.rows]


def _tracking(runs: Sequence[ScoredRun]) -> TextTable:
    figures = {
        "AMOTA": "amota",
        "MOTA": "mota",
        "recall": "recall",
        "switches": "id_switches",
        "IDF1": "idf1",
        "HOTA": "hota",
    }
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        numbers = run.scores.overall.as_dict()
        rows.append((run.title, *(numbers[key] for key in figures.values())))
    columns = [Column("run"), *(Column(name) for name in figures)]
    kinds = len({name for run in runs for name in run.scores.classes})
    what = f"all {kinds} classes" if kinds > 1 else "all boxes, whatever their class"
    return _without_empty(TextTable("tracking", f"Tracking, {what}", tuple(columns), tuple(rows)))


def _velocity(runs: Sequence[ScoredRun]) -> TextTable:
    kinds = {
        "all": "all",
        "fast": FAST,
        "slow": SLOW,
        "still": STATIONARY,
        "unlabelled": UNLABELLED,
    }
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        means = [run.velocity_error(row).mean_mps for row in kinds.values()]
        rows.append((run.title, *means, run.velocity_error("all").worst_mean_mps))
    columns = (Column("run"), *(Column(name) for name in kinds), Column("all, worst 5 %"))
    title = "Velocity error of tracks, mean, m/s"
    return _without_empty(TextTable("velocity", title, columns, tuple(rows)))


def _flow(runs: Sequence[ScoredRun]) -> TextTable:
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        moving, resting = run.scores.flow.get("dynamic"), run.scores.flow.get("static")
        if moving is not None:
            share = f"{moving.within_1_mps:.0%}" if moving.cells else None
            static = None if resting is None else resting.rmse_mps
            rows.append((run.title, moving.rmse_mps, moving.median_mps, share, static))
    names = ("dynamic: RMSE", "median", "within 1 m/s", "static: RMSE")
    columns = (Column("run"), *(Column(name) for name in names))
    return _without_empty(TextTable("flow", "Flow error of cells, m/s", columns, tuple(rows)))


def _label_free(runs: Sequence[ScoredRun]) -> TextTable:
    figures = {
        "error": label_free.ERROR,
        "moving: residual": label_free.MOVING,
        "static: residual": label_free.STATIC,
        "explained, %": label_free.EXPLAINED,
        "consistent, %": label_free.CONSISTENT,
        "NIS": label_free.NIS,
    }
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        found = judgements(run, run.finished)
        if found is not None:
            values = (whole(found.metric(key), len(found.scenes)) for key in figures.values())
            rows.append((run.title, *values))
    columns = (Column("run"), *(Column(name) for name in figures))
    title = "Flow judged without labels, m/s"
    return _without_empty(TextTable("label_free", title, columns, tuple(rows), RANKS))


def _latency(runs: Sequence[ScoredRun]) -> TextTable:
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        report = run.latency
        if report is None or TOTAL not in report.stages:
            continue
        total = report.stages[TOTAL]
        stages = [report.stages[name].p50_ms if name in report.stages else None for name in ORDER]
        late = f"{report.over_budget}/{report.steps}"
        warm_up = f"{report.warm_up_ms[TOTAL] / 1e3:.1f} s"
        rows.append((run.title, *stages, total.p50_ms, total.p99_ms, late, warm_up))
    budgets = sorted({f"{r.latency.budget_ms:.0f} ms" for r in runs if r.latency is not None})
    names = (*ORDER, "whole", "p99")
    columns = (
        Column("run"),
        *(Column(name, digits=1) for name in names),
        Column("late"),
        Column("warm-up"),
    )
    title, note = "Latency of a step, median, ms", LATENCY.format(budget=" or ".join(budgets))
    return _without_empty(TextTable("latency", title, columns, tuple(rows), note))


def _differences(parts: Sequence[RunDifferences]) -> Iterator[TextTable]:
    """Yield a table for each run; the last one says how significance was found."""
    columns = tuple(Column(name) for name in ("metric", "baseline", "value", "difference", ""))
    for part in parts:
        found = {row.key: row for row in part.rows if row.difference == row.difference}
        rows = tuple(_difference(found[key], name) for key, name in SHORT.items() if key in found)
        plural = "" if part.scenes == 1 else "s"
        title = f"{part.run} against {part.baseline}, {part.scenes} scene{plural}"
        note = (METHOD if part.scenes > 1 else ONE_SCENE) if part is parts[-1] else ""
        yield TextTable("differences", title, columns, rows, note)


def _unlabelled(part: RunDifferences) -> RunDifferences:
    """Return the differences that need no truth: of no objects there are no errors."""
    return replace(part, rows=tuple(row for row in part.rows if row.key == label_free.ERROR))


def _difference(row: PairedDifference, name: str) -> tuple[Cell, ...]:
    digits = 0 if row.key.metric == "IDS" else 3
    known = row.low == row.low
    half = f" ± {row.high - row.difference:.{digits}f}" if known else ""
    values = [f"{value:.{digits}f}" for value in (row.baseline, row.value)]
    verdict = "" if row.better is None else significance(row)
    return name, *values, f"{row.difference:+.{digits}f}{half}", verdict


def _without_empty(table: TextTable) -> TextTable:
    """Leave out the columns in which no run has a value."""
    kept = [k for k in range(len(table.columns)) if any(_exists(row[k]) for row in table.rows)]
    columns = tuple(table.columns[k] for k in kept)
    rows = tuple(tuple(row[k] for k in kept) for row in table.rows)
    return TextTable(table.name, table.title, columns, rows, table.note)


def _exists(cell: Cell) -> bool:
    return cell is not None and cell == cell

"""Tables of a comparison, for the terminal and for CSV, Markdown and LaTeX files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from mottrack.eval.paired import CONFIDENCE, RESAMPLES, MetricKey, PairedDifference
from mottrack.experiment.overrides import GROUPS
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.runs.comparison import Comparison
from mottrack.runs.criteria import criteria_table
from mottrack.runs.differences import RunDifferences
from mottrack.runs.label_free import label_free_table
from mottrack.runs.scene_flow import scene_flow_tables
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.velocity_bench import bench_table

VELOCITY_PARTS = ("mean", "worst 5 %", "rows")
FLOW_PARTS = ("RMSE", "median", "within 1 m/s")
METHOD = (
    f"{CONFIDENCE:.0%} confidence intervals of the paired difference: every metric is evaluated on "
    f"{RESAMPLES} resamples of the scenes; Student's t with the number of scenes. About 1 in "
    f"{round(1 / (1 - CONFIDENCE))} null differences is reported as significant"
)
LATENCY = (
    "Wall time of the steps in which every stage ran, without reading files and without the "
    "warm-up. Parallel processes slow each other down: use --workers 1 to measure one scene alone"
)


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Return every table of the finished runs."""
    runs = [run for run in comparison.runs if run.report.finished]
    if not runs:
        return []
    tables = [tracking_table(runs), velocity_table(runs), latency_table(runs)]
    if len(runs) > 1:
        tables.append(settings_table(runs))
    if any(run.scores.flow for run in runs):
        tables.insert(2, flow_table(runs))
    tables += scene_flow_tables(runs)
    label_free = label_free_table(runs)
    if label_free is not None:
        tables.append(label_free)
    if comparison.flow_values:
        tables.append(bench_table(comparison.flow_values))
    tables.append(criteria_table(comparison.judged))
    if comparison.differences:
        tables.append(difference_table(comparison.differences))
    return [table for table in tables if table.rows]


def tracking_table(runs: Sequence[ScoredRun]) -> TextTable:
    """Tabulate AMOTA and the other tracking metrics, over all classes and of each."""
    figures = (
        ("AMOTA", "amota"),
        ("AMOTP m", "amotp_m"),
        ("MOTA", "mota"),
        ("MOTP m", "motp_m"),
        ("recall", "recall"),
        ("misses", "misses"),
        ("false pos.", "false_positives"),
        ("switches", "id_switches"),
        ("IDF1", "idf1"),
        ("HOTA", "hota"),
    )
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        for label, scores in {"all": run.scores.overall, **run.scores.classes}.items():
            numbers = scores.as_dict()
            if not (numbers["truth_boxes"] or numbers["false_positives"]):
                continue  # a class that the data set knows, but neither truth nor tracks have
            if not numbers["truth_boxes"]:  # TrackEval's 0 would read as the worst result
                numbers["hota"] = float("nan")
            rows.append((run.title, label, *(numbers[name] for _, name in figures)))
    columns = (Column("run"), Column("class"), *(Column(name) for name, _ in figures))
    by = {"distance": "centre distance", "iou": "3-D IoU"}[runs[0].config.match_by]
    return TextTable("tracking", f"Tracking, matched by {by}", columns, tuple(rows))


def velocity_table(runs: Sequence[ScoredRun]) -> TextTable:
    """Tabulate the velocity error of tracks by category, a group of columns per run."""
    names = [f"{run.title}: {part}" for run in runs for part in VELOCITY_PARTS]
    rows: list[tuple[Cell, ...]] = []
    if not any(run.velocity_error("all").count for run in runs):  # trackers that report none
        return TextTable("velocity", "Track velocity error, m/s", (Column("tracks"),), ())
    for row in dict.fromkeys(row for run in runs for row in run.scores.velocity):
        cells: list[Cell] = []
        for error in (run.velocity_error(row) for run in runs):
            cells += [error.mean_mps, error.worst_mean_mps, error.count]
        rows.append((row, *cells))
    columns = (Column("tracks"), *(Column(name) for name in names))
    return TextTable("velocity", "Track velocity error, m/s", columns, tuple(rows))


def flow_table(runs: Sequence[ScoredRun]) -> TextTable:
    """Tabulate the flow error by kind of cell, a group of columns per run."""
    names = [f"{run.title}: {part}" for run in runs for part in FLOW_PARTS]
    rows: list[tuple[Cell, ...]] = []
    for row in dict.fromkeys(row for run in runs for row in run.scores.flow):
        cells: list[Cell] = []
        for error in (run.scores.flow.get(row) for run in runs):
            if error is None:
                cells += [None, None, None]
            else:
                cells += [error.rmse_mps, error.median_mps, error.within_1_mps]
        rows.append((row, *cells))
    columns = (Column("cells"), *(Column(name) for name in names))
    return TextTable("flow", "Flow error, m/s", columns, tuple(rows))


def latency_table(runs: Sequence[ScoredRun]) -> TextTable:
    """Tabulate the latency of every stage of a step and of its parts."""
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        report = run.latency
        for stage, s in ({} if report is None else report.stages).items():
            warm_up_ms = 0.0 if report is None else report.warm_up_ms.get(stage, 0.0)
            times = (s.mean_ms, s.p50_ms, s.p99_ms, s.max_ms, warm_up_ms)
            rows.append((run.title, stage, *times, s.steps))
    names = ("mean", "p50", "p99", "max", "warm-up")
    columns = (
        Column("run"),
        Column("stage"),
        *(Column(name, digits=1) for name in names),
        Column("steps"),
    )
    return TextTable("latency", "Latency of a step, ms", columns, tuple(rows), LATENCY)


def difference_table(parts: Sequence[RunDifferences]) -> TextTable:
    """Tabulate every metric of every run against its baseline, one row each."""
    columns = (
        *(Column(name) for name in ("run", "baseline", "metric", "baseline value", "value")),
        Column("difference", signed=True),
        Column("low", signed=True),
        Column("high", signed=True),
        Column("significance"),
        Column("scenes"),
    )
    rows: list[tuple[Cell, ...]] = []
    for part in parts:
        for row in part.rows:
            names = (part.run, part.baseline, metric_name(row.key))
            numbers = (row.baseline, row.value, row.difference, row.low, row.high)
            rows.append((*names, *numbers, significance(row), row.scenes))
    return TextTable("differences", "Differences to the baseline", columns, tuple(rows), METHOD)


def settings_table(runs: Sequence[ScoredRun]) -> TextTable:
    """Tabulate the settings in which the runs differ, a column per run.

    Of a part of another kind the kind alone is listed: its settings are others altogether.
    """
    flat = [flat_settings(run.experiment.resolved()) for run in runs]
    names = dict.fromkeys(name for settings in flat for name in settings)
    values = {name: [settings.get(name) for settings in flat] for name in names}
    other_kind = {g for g in GROUPS if len(set(values.get(f"{g}.kind", ()))) > 1}
    rows: list[tuple[Cell, ...]] = [
        (name, *found)
        for name, found in values.items()
        if len(set(found)) > 1
        and (name.endswith(".kind") or name.partition(".")[0] not in other_kind)
    ]
    columns = (Column("setting"), *(Column(run.title) for run in runs))
    return TextTable("settings", "Settings in which the runs differ", columns, tuple(rows))


def flat_settings(tree: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Return settings by their dotted names, as text; what differs in kind has no other names."""
    flat: dict[str, str] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            flat |= flat_settings(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value, default=str)
    return flat


def metric_name(key: MetricKey) -> str:
    """Return the name of a metric in a table of differences, with its unit."""
    if key.table == "sceneflow":
        return f"scene flow, {key.title}"
    what = {"tracking": "", "flow": "flow, ", "velocity": "velocity, ", "runtime": "time, "}
    what["label-free"] = "flow without labels, "
    row = "" if key.table == "tracking" else f"{key.row}, "
    unit = f" ({key.unit})" if key.unit else ""
    return f"{what[key.table]}{row}{key.metric}{unit}"


def significance(row: PairedDifference) -> str:
    """Return whether a difference is significant, in a word or two."""
    if row.low != row.low:
        return "one scene" if row.scenes == 1 else "no interval"
    return {True: "better", False: "worse", None: "not significant"}[row.better]

"""What flow was worth in a comparison: runs that differ in their flow alone, beside the oracle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mottrack.eval.paired import CONFIDENCE, MetricKey, PairedDifference, Sampled, paired
from mottrack.eval.run_metrics import OFFICIAL
from mottrack.eval.velocity_value import (
    ALL,
    FAST,
    TABLE,
    Value,
    headroom,
    relative_change,
    value_metrics,
)
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.runs.differences import sample_runs
from mottrack.runs.per_scene import PerScene
from mottrack.runs.scored_run import ScoredRun

NO_FLOW, ORACLE = "zero", "ground_truth"
AMOTA, IDS = OFFICIAL[0], OFFICIAL[4]  # as OFFICIAL lists them
VELOCITY = MetricKey(TABLE, ALL, "velocity error")
PREDICTION = MetricKey(TABLE, FAST, "1 s prediction")
NOTE = (
    f"Rows that every run of the group has. {CONFIDENCE:.0%} intervals over resampled scenes. "
    "Headroom: the oracle's gain over no flow; a share is given where that gain is significant"
)


@dataclass(frozen=True)
class FlowValue:
    """One flow source against no flow with the same tracker and objects."""

    run: str
    baseline: str
    oracle: bool
    """Whether its flow is the truth."""
    rows: tuple[PairedDifference, ...]
    shares: tuple[Value, ...]
    """Of the oracle's headroom; empty for the oracle itself and without one."""
    changes: dict[MetricKey, Value]
    """Relative change against the baseline, where that is above 0."""

    def row(self, key: MetricKey) -> PairedDifference | None:
        """Return the difference in one metric, if both runs have it."""
        return next((row for row in self.rows if row.key == key), None)


def metric_key(metric: str, objects: str = ALL) -> MetricKey:
    """Return the key of a metric of the table, as criteria name it."""
    plain = {"AMOTA": AMOTA, "identity switches": IDS, "1 s prediction": PREDICTION}
    return plain.get(metric) or MetricKey(TABLE, objects, metric)


def flow_values(runs: Sequence[ScoredRun]) -> list[FlowValue]:
    """Return the worth of every flow source that was run beside no flow."""
    finished = [run for run in runs if run.finished]
    groups = dict.fromkeys(_rest(run) for run in finished)
    return [value for rest in groups for value in _group([r for r in finished if _rest(r) == rest])]


def _rest(run: ScoredRun) -> tuple[str, str]:
    """Return what the runs of a group share: the data set, and objects with tracker by hash."""
    e = run.experiment
    return run.dataset, repr((e.objects.kind, e.objects.config, e.tracker.kind, e.tracker.config))


def _group(runs: Sequence[ScoredRun]) -> list[FlowValue]:
    none = next((run for run in runs if run.experiment.flow.kind == NO_FLOW), None)
    if none is None or len(runs) < 2:
        return []
    resamples = sample_runs(runs)
    if not resamples.scenes:
        return []
    results = {
        run.title: PerScene(resamples.scenes, partial(run.folder.load, flow=False)) for run in runs
    }
    figures = value_metrics(results, none.config.velocity, resamples.weights)
    for title, official in resamples.figures.items():
        figures[title] |= {key: official[key] for key in (AMOTA, IDS) if key in official}
    oracle = next((run.title for run in runs if run.experiment.flow.kind == ORACLE), None)
    base = figures[none.title]
    found = []
    for run in runs:
        if run.experiment.flow.kind == NO_FLOW:  # the baseline, or one that differs elsewhere
            continue
        own = figures[run.title]
        rows = tuple(paired(key, base[key], own[key]) for key in base if key in own)
        best = None if oracle in (None, run.title) else figures[str(oracle)]
        shares = () if best is None else _shares(base, own, best)
        changes = {k: relative_change(k.metric, base[k], own[k]) for k in base if k in own}
        known = {key: change for key, change in changes.items() if change is not None}
        found.append(FlowValue(run.title, none.title, run.title == oracle, rows, shares, known))
    return found


def _shares(
    base: dict[MetricKey, Sampled], run: dict[MetricKey, Sampled], oracle: dict[MetricKey, Sampled]
) -> tuple[Value, ...]:
    names = {AMOTA: "AMOTA", VELOCITY: "velocity error", PREDICTION: "1 s prediction"}
    values = (
        headroom(name, base[key], run[key], oracle[key])
        for key, name in names.items()
        if key in base and key in run and key in oracle
    )
    return tuple(value for value in values if value is not None)


def bench_table(values: Sequence[FlowValue]) -> TextTable:
    """Tabulate every metric of every source, then the shares of the headroom."""
    rows: list[tuple[Cell, ...]] = []
    for value in values:
        for row in value.rows:
            name = f"{row.key.row}, {row.key.metric}" if row.key.table == TABLE else row.key.metric
            numbers = (row.baseline, row.value, row.difference, row.low, row.high)
            rows.append((value.run, name, *numbers))
        for share in value.shares:
            name = f"share of the headroom in {share.metric}"
            rows.append((value.run, name, None, None, share.share, share.low, share.high))
    columns = (
        *(Column(name) for name in ("run", "metric", "no flow", "with flow")),
        *(Column(name, signed=True) for name in ("difference", "low", "high")),
    )
    return TextTable("flow_value", "What flow was worth", columns, tuple(rows), NOTE)


def plain_words(values: Sequence[FlowValue]) -> list[str]:
    """Say in three lines what the best measured flow was worth; nothing if none was measured.

    The best is the one with the largest gain among those that are significantly better than no
    flow, or among all where none is.
    """
    measured = [v for v in values if not v.oracle and v.row(VELOCITY) is not None]
    if not measured:
        return []
    better = [v for v in measured if (row := v.row(VELOCITY)) is not None and row.better]
    best = min(better or measured, key=lambda v: _gain(v.row(VELOCITY)))
    rows = [best.row(key) for key in (VELOCITY, PREDICTION, AMOTA)]
    counted = rows[2] or best.row(IDS)  # clusters have no AMOTA
    last = _described(counted, "AMOTA" if rows[2] else "identity switches", "")
    return [
        f"Flow ({best.run}) against none, on objects that every run tracks: "
        f"{_described(rows[0], 'velocity error', ' m/s')}.",
        f"Where fast objects will be in 1 s: {_described(rows[1], 'error', ' m')}.",
        f"Of the gain of the true velocity: {_shares_described(best)}; {last}.",
    ]


def _shares_described(value: FlowValue) -> str:
    """Return the shares of the headroom in a phrase."""
    shares = [f"{_share(share)} in {share.metric}" for share in value.shares]
    return ", ".join(shares) if shares else "no share (no oracle was run, or its gain is uncertain)"


def _gain(row: PairedDifference | None) -> float:
    return np.inf if row is None else row.difference


def _described(row: PairedDifference | None, name: str, unit: str) -> str:
    """Return a metric without and with flow, and the difference with its interval."""
    if row is None:
        return f"{name} not measured"
    digits = 0 if row.key == IDS else 3
    interval = "(one scene)"
    if row.low == row.low:
        interval = f"[{row.low:+.{digits}f}, {row.high:+.{digits}f}]"
    verdict = {True: "better", False: "worse", None: "not significant"}[row.better]
    if row.low != row.low:
        verdict = "of unknown significance"
    change = f"{row.baseline:.{digits}f} -> {row.value:.{digits}f}{unit}"
    return f"{name} {change}, difference {row.difference:+.{digits}f} {interval}, {verdict}"


def _share(share: Value) -> str:
    if share.low != share.low:
        return f"{share.share:.0%}"
    return f"{share.share:.0%} [{share.low:.0%}, {share.high:.0%}]"

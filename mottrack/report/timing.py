"""Wall time of the stages of a run beside the real-time budget of a 10 Hz sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.eval.metric_info import MetricInfo
from mottrack.eval.streams import Distribution, Wanted
from mottrack.report.ranking import NAN, Cell, ReportRun, ranked_cells
from mottrack.report.tables import Row

BUDGET_MS = 100.0
"""Time between two sweeps at 10 Hz."""
WIDEST_BUDGETS = 8
"""The plot shows at most so many budgets: one very slow run would shrink all others to nothing."""
ORDER = ("flow", "objects", "velocity", "tracker")
"""Stages in the order in which a step runs them."""
NOT_COUNTED = ("read", "total")
"""A vehicle reads no files; a total is the sum of the others."""
TIMING = MetricInfo(
    "total_ms",
    "time per key frame",
    "Median wall time of flow, objects, velocity and tracker for one key frame without reading, "
    "one thread per scene. A 10 Hz sensor leaves 100 ms.",
    lower_is_better=True,
    digits=1,
    unit="ms",
)


@dataclass(frozen=True)
class Timing:
    """Wall time of the key frames of a run."""

    stage_ms: dict[str, float]
    """Mean of each stage."""
    median_ms: float
    """Of the sum of all stages."""
    p95_ms: float
    within_budget: float
    """Share of the key frames that took at most the budget."""

    @property
    def total_ms(self) -> float:
        """Mean of the sum of all stages."""
        return sum(self.stage_ms.values())

    @classmethod
    def of(cls, timings_s: Sequence[Mapping[str, F64]]) -> Timing | None:
        """Summarise the key frames of all scenes; return None where nothing was timed.

        Args:
            timings_s: of each scene, per stage (T,) seconds; read twice, and not held.
        """
        names = {stage for scene in timings_s for stage in scene}
        stages = sorted(names - set(NOT_COUNTED), key=_place)
        if not stages:
            return None
        every = {stage: Distribution(Wanted()) for stage in stages}
        total, within = Distribution(Wanted(quantiles=(0.5, 0.95))), 0
        for scene in timings_s:
            spent_ms = _milliseconds(scene, stages)
            for stage, ms in spent_ms.items():
                every[stage].count(ms)
            total.count(_total(spent_ms))
        for scene in timings_s:
            spent_ms = _milliseconds(scene, stages)
            for stage, ms in spent_ms.items():
                every[stage].add(ms)
            total.add(_total(spent_ms))
            within += int(np.count_nonzero(_total(spent_ms) <= BUDGET_MS))
        means = {stage: values.mean for stage, values in every.items()}
        return cls(means, total.quantile(0.5), total.quantile(0.95), within / total.size)


def _milliseconds(timings_s: Mapping[str, F64], stages: Sequence[str]) -> dict[str, F64]:
    """Return per stage (T,) milliseconds; 0 where a stage did not run."""
    frames = max(map(len, timings_s.values()), default=0)
    return {stage: 1e3 * timings_s.get(stage, np.zeros(frames)) for stage in stages}


def _total(spent_ms: Mapping[str, F64]) -> F64:
    total: F64 = np.sum(list(spent_ms.values()), axis=0)
    return total


def stages_of(timings: Sequence[Timing | None]) -> list[str]:
    """Return every stage that any run has, in the order of a step."""
    return sorted({stage for t in timings if t is not None for stage in t.stage_ms}, key=_place)


def _place(stage: str) -> tuple[int, str]:
    """Sort key: place in a step; stages that the pipeline does not know come last."""
    return ORDER.index(stage) if stage in ORDER else len(ORDER), stage


def widest_ms(timings: Sequence[Timing | None]) -> float:
    """Return the time at the right end of the plot; longer bars are cut off."""
    totals = [t.total_ms for t in timings if t is not None]
    return min(max([1.25 * BUDGET_MS, *totals]), WIDEST_BUDGETS * BUDGET_MS)


def time_rows(runs: Sequence[ReportRun], timings: Sequence[Timing | None]) -> list[Row]:
    """Return mean of each stage, median and 95th percentile of the sum, share within budget."""
    medians = ranked_cells(TIMING, [NAN if t is None else t.median_ms for t in timings], runs)
    rows = []
    for run, timing, median in zip(runs, timings, medians, strict=True):
        if timing is not None:
            means = [Cell(TIMING.text(timing.stage_ms.get(s, 0.0))) for s in stages_of(timings)]
            share = Cell(f"{100 * timing.within_budget:.0f} %")
            cells = (*means, median, Cell(TIMING.text(timing.p95_ms)), share)
            rows.append(Row(run.title, cells, run))
    return rows

"""Wall time of the stages of a run beside the real-time budget of a 10 Hz sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.eval.metric_info import MetricInfo
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
    def of(cls, results: Sequence[SceneResult]) -> Timing | None:
        """Summarise all key frames of the scenes; return None where nothing was timed."""
        timed = [result.timings_s for result in results if result.timings_s]
        stages = sorted({s for t in timed for s in t} - set(NOT_COUNTED), key=_place)
        if not stages:
            return None
        absent = [np.zeros(len(next(iter(t.values())))) for t in timed]
        stage_ms = {
            stage: 1e3
            * np.concatenate([t.get(stage, zero) for t, zero in zip(timed, absent, strict=True)])
            for stage in stages
        }
        total = np.sum(list(stage_ms.values()), axis=0)
        median, p95 = np.percentile(total, (50, 95))
        means = {stage: float(values.mean()) for stage, values in stage_ms.items()}
        return cls(means, float(median), float(p95), float((total <= BUDGET_MS).mean()))


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

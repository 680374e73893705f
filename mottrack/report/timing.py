"""Latency of the runs beside the real-time budget: the time between two sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.eval.metric_info import MetricInfo
from mottrack.pipeline.latency import ORDER, TOTAL, LatencyReport
from mottrack.report.ranking import Cell, ReportRun
from mottrack.report.tables import Row

WIDEST_BUDGETS = 8
"""The plot shows at most so many budgets: one very slow run would shrink all others to nothing."""
FREE_SHARE = 1.25
"""Of the longest bar or the budget: the width of the plot, so that its end is seen."""
TIMING = MetricInfo(
    "total_ms",
    "latency",
    "Median wall time of a step in which every stage ran (flow, objects, velocity, tracker), one "
    "thread per scene, without reading files and without the warm-up. The budget is the time "
    "between two sweeps.",
    lower_is_better=True,
    digits=1,
    unit="ms",
)


@dataclass(frozen=True)
class Timing:
    """Latency of a run, in milliseconds."""

    stage_ms: dict[str, float]
    """Median of each stage."""
    median_ms: float
    """Of the whole step."""
    p99_ms: float
    budget_ms: float
    within_budget: float
    """Share of the steps that took at most the budget."""
    warm_up_ms: float
    """Loading and compiling, not among the others."""

    @property
    def total_ms(self) -> float:
        """Length of the bar: its stages end to end."""
        return sum(self.stage_ms.values())

    @classmethod
    def of(cls, report: LatencyReport | None) -> Timing | None:
        """Summarise a run; None where nothing was timed."""
        if report is None or TOTAL not in report.stages:
            return None
        total = report.stages[TOTAL]
        return cls(
            {s: report.stages[s].p50_ms for s in ORDER if s in report.stages},
            total.p50_ms,
            total.p99_ms,
            report.budget_ms,
            1.0 - report.over_budget_share,
            report.warm_up_ms.get(TOTAL, 0.0),
        )


def stages_of(timings: Sequence[Timing | None]) -> list[str]:
    """Return every stage that any run has, in the order of a step."""
    found = {stage for t in timings if t is not None for stage in t.stage_ms}
    return [stage for stage in ORDER if stage in found]


def budget_ms(timings: Sequence[Timing | None]) -> float:
    """Return the shortest budget of the runs; that of a 10 Hz sensor where nothing was timed."""
    return min((t.budget_ms for t in timings if t is not None), default=100.0)


def widest_ms(timings: Sequence[Timing | None]) -> float:
    """Return the time at the right end of the plot; longer bars are cut off."""
    totals = [t.total_ms for t in timings if t is not None]
    budget = budget_ms(timings)
    return min(FREE_SHARE * max([budget, *totals]), WIDEST_BUDGETS * budget)


def time_rows(runs: Sequence[ReportRun], timings: Sequence[Timing | None]) -> list[Row]:
    """Return median of each stage and of the whole, 99th percentile, share in time, warm-up."""
    rows = []
    for run, timing in zip(runs, timings, strict=True):
        if timing is not None:
            numbers = [timing.stage_ms.get(s, 0.0) for s in stages_of(timings)]
            cells = [Cell(TIMING.text(n)) for n in (*numbers, timing.median_ms, timing.p99_ms)]
            share = Cell(f"{100 * timing.within_budget:.0f} %")
            rows.append(Row(run.title, (*cells, share, Cell(f"{timing.warm_up_ms:.0f}")), run))
    return rows

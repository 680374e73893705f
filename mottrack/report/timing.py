"""How long the stages of a run took, and whether that keeps up with a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.report.measures import TIMING
from mottrack.report.ranking import Cell, ReportRun, best_of
from mottrack.report.tables import Row

BUDGET_MS = 100.0
"""Time between two sweeps at 10 Hz."""
WIDEST_BUDGETS = 8
ORDER = ("flow", "objects", "velocity", "tracker")
NOT_COUNTED = ("read", "total")
"""A vehicle reads no files; a total is the sum of the others."""


@dataclass(frozen=True)
class Timing:
    """Wall time of the key frames of a run."""

    stage_ms: dict[str, float]
    """Mean of each stage."""
    median_ms: float
    """Of all stages together."""
    p95_ms: float
    within_budget: float
    """Share of the key frames that took no longer than the budget."""

    @classmethod
    def of(cls, results: Sequence[SceneResult]) -> Timing | None:
        """Over all key frames of the scenes; None where nothing was timed."""
        timed = [result.timings_s for result in results if result.timings_s]
        stages = sorted({s for t in timed for s in t} - set(NOT_COUNTED), key=_place)
        if not stages:
            return None
        frames = [len(next(iter(t.values()))) for t in timed]
        stacked = {
            stage: 1e3
            * np.concatenate(
                [t.get(stage, np.zeros(n)) for t, n in zip(timed, frames, strict=True)]
            )
            for stage in stages
        }
        total = np.sum(list(stacked.values()), axis=0)
        median, p95 = np.percentile(total, (50, 95))
        means = {stage: float(values.mean()) for stage, values in stacked.items()}
        return cls(means, float(median), float(p95), float((total <= BUDGET_MS).mean()))


@dataclass(frozen=True)
class Part:
    """One stage of a bar."""

    percent: float
    """Of the width of the plot."""
    colour: int
    words: str


@dataclass(frozen=True)
class TimeBar:
    """Mean time of a run's stages, one after the other, beside the budget."""

    entrant: ReportRun
    parts: tuple[Part, ...]
    budget_percent: float
    total: str

    @property
    def words(self) -> str:
        """All parts, for those who can't see them."""
        return f"{self.entrant.title}: " + ", ".join(part.words for part in self.parts)


def stages_of(timings: Sequence[Timing | None]) -> list[str]:
    """Every stage that any run has, in order."""
    return sorted({stage for t in timings if t is not None for stage in t.stage_ms}, key=_place)


def _place(stage: str) -> tuple[int, str]:
    """Where a stage stands in a step; one that the pipeline does not know comes last."""
    return ORDER.index(stage) if stage in ORDER else len(ORDER), stage


def time_bars(entrants: Sequence[ReportRun], timings: Sequence[Timing | None]) -> list[TimeBar]:
    """One bar a run, on one scale; those far beyond the budget leave the plot at its right end."""
    totals = [sum(t.stage_ms.values()) for t in timings if t is not None]
    scale = min(max([1.25 * BUDGET_MS, *totals]), WIDEST_BUDGETS * BUDGET_MS)
    stages = stages_of(timings)
    bars = []
    for entrant, timing in zip(entrants, timings, strict=True):
        if timing is None:
            continue
        parts = [
            Part(100 * ms / scale, stages.index(stage), f"{stage} {ms:.1f} ms")
            for stage, ms in timing.stage_ms.items()
        ]
        total = sum(timing.stage_ms.values())
        text = f"{total:.0f} ms" + (" »" if total > scale else "")
        bars.append(TimeBar(entrant, tuple(parts), 100 * BUDGET_MS / scale, text))
    return bars


def time_rows(entrants: Sequence[ReportRun], timings: Sequence[Timing | None]) -> list[Row]:
    """Mean of each stage, median and 95th percentile of all, share within the budget."""
    medians = [float("nan") if t is None else t.median_ms for t in timings]
    best = best_of(TIMING, medians, entrants)
    rows = []
    for entrant, timing, is_best in zip(entrants, timings, best, strict=True):
        if timing is not None:
            cells = [Cell(TIMING.text(timing.stage_ms.get(s, 0.0))) for s in stages_of(timings)]
            cells.append(Cell(TIMING.text(timing.median_ms), is_best))
            cells.append(Cell(TIMING.text(timing.p95_ms)))
            cells.append(Cell(f"{100 * timing.within_budget:.0f} %"))
            rows.append(Row(entrant.title, tuple(cells), entrant))
    return rows

"""Which of several figures is the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.report.measures import Measure
from mottrack.runs.comparison import ScoredRun

ORACLE_FLOW, NO_FLOW = "ground_truth", "zero"


@dataclass(frozen=True)
class ReportRun:
    """A run as the report shows it."""

    index: int
    """Its place in the comparison, which gives it its colour."""
    run: ScoredRun

    @property
    def title(self) -> str:
        """What names it."""
        return self.run.title

    @property
    def oracle(self) -> bool:
        """Whether it was given the true flow."""
        return self.run.experiment.flow.kind == ORACLE_FLOW

    @property
    def has_truth(self) -> bool:
        """Whether anything was there to score it against."""
        return self.run.scores.overall.clear.truth > 0

    @property
    def measures_flow(self) -> bool:
        """Whether there is any flow to look at."""
        return self.run.experiment.flow.kind != NO_FLOW


@dataclass(frozen=True)
class Cell:
    """A figure in a table."""

    text: str
    best: bool = False
    under: tuple[tuple[str, bool], ...] = ()
    """What stands small below it, and whether it is the best of its kind."""


def best_of(
    measure: Measure, values: Sequence[float], entrants: Sequence[ReportRun]
) -> tuple[bool, ...]:
    """Which values are the best as they are printed; oracles are out of the contest.

    Nothing is the best where fewer than two take part, or where all are the same.
    """
    competes = [
        v == v and not e.oracle and measure.lower_is_better is not None
        for v, e in zip(values, entrants, strict=True)
    ]
    rivals = [v for v, c in zip(values, competes, strict=True) if c]
    if len({measure.text(v) for v in rivals}) < 2:
        return (False,) * len(values)
    top = measure.text(min(rivals) if measure.lower_is_better else max(rivals))
    return tuple(c and measure.text(v) == top for v, c in zip(values, competes, strict=True))

"""The runs of a report and the ranking of their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.eval.metric_info import MetricInfo
from mottrack.runs.comparison import ScoredRun

NAN = float("nan")
ORACLE_FLOW, NO_FLOW = "ground_truth", "zero"


@dataclass(frozen=True)
class ReportRun:
    """A run as the report shows it."""

    index: int
    """Its place in the comparison, which gives it its colour."""
    scored: ScoredRun

    @property
    def title(self) -> str:
        """Name of the run in tables."""
        return self.scored.title

    @property
    def oracle(self) -> bool:
        """Whether it was given the true flow."""
        return self.scored.experiment.flow.kind == ORACLE_FLOW

    @property
    def has_truth(self) -> bool:
        """Whether there was any truth to score it against."""
        return self.scored.scores.overall.clear.truth > 0

    @property
    def measures_flow(self) -> bool:
        """Whether its flow source is one that measures anything."""
        return self.scored.experiment.flow.kind != NO_FLOW


@dataclass(frozen=True)
class Cell:
    """A value in a table."""

    text: str
    best: bool = False
    under: tuple[Cell, ...] = ()
    """Secondary values, printed small below it."""


def ranked_cells(
    info: MetricInfo, values: Sequence[float], runs: Sequence[ReportRun]
) -> list[Cell]:
    """Print one value per run and mark the best ones; oracles are not ranked.

    Values are compared as printed. None is marked if fewer than two runs are ranked or all agree.
    """
    texts = [info.text(value) for value in values]
    ranked = [
        v == v and not run.oracle and info.lower_is_better is not None
        for v, run in zip(values, runs, strict=True)
    ]
    rivals = {text: v for v, text, r in zip(values, texts, ranked, strict=True) if r}
    best = ""
    if len(rivals) > 1:
        best = (min if info.lower_is_better else max)(rivals, key=lambda text: rivals[text])
    return [Cell(text, r and text == best) for text, r in zip(texts, ranked, strict=True)]

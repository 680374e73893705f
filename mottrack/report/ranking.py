"""The runs of a report, and the cells of its tables with verdicts that are significant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from mottrack.eval.metric_info import MetricInfo
from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.runs.comparison import ScoredRun
from mottrack.runs.differences import RunDifferences
from mottrack.runs.equal_runs import equal_runs

NAN = float("nan")
NO_FLOW = "zero"
COLOURS = 8
"""Of css/base.css: --run-0 and so on."""
FLOW_COLOURS = {
    "zero": 0,
    "cluster_icp": 1,
    "pillarflow": 2,
    "ground_truth": 3,
    "icp": 4,
    "dogma": 5,
    "binary_ogm": 6,
}
"""The same flow source has the same colour in every report."""

Verdict = Literal["better", "worse", "not significant", "too few scenes"]


@dataclass(frozen=True)
class ReportRun:
    """A run as the report shows it."""

    index: int
    """Its place in the report."""
    scored: ScoredRun
    colour: int = 0
    """Number of its colour."""
    same: tuple[str, ...] = ()
    """Titles of runs with the same tracks, which are not shown apart."""

    @property
    def title(self) -> str:
        """Name of the run in tables."""
        return self.scored.title

    @property
    def oracle(self) -> bool:
        """Whether it was given the true flow."""
        return self.scored.given_truth

    @property
    def has_truth(self) -> bool:
        """Whether there was any truth to score it against."""
        return self.scored.has_truth

    @property
    def measures_flow(self) -> bool:
        """Whether its flow source is one that measures anything."""
        return self.scored.experiment.flow.kind != NO_FLOW

    @property
    def clusters(self) -> bool:
        """Whether its tracks have no class of the truth: a wall is then a false positive."""
        return self.has_truth and not self.scored.scores.classes


def report_runs(scored: Sequence[ScoredRun]) -> list[ReportRun]:
    """Give each run its colour; of runs with equal tracks only the first is shown."""
    shown: dict[str, ReportRun] = {}
    equal = equal_runs(scored)
    for run in scored:
        twin = shown.get(equal.get(run.title, ""))
        if twin is None:
            colour = _colour(run, [r.colour for r in shown.values()])
            shown[run.title] = ReportRun(len(shown), run, colour)
        else:
            same = (*twin.same, run.title)
            shown[twin.title] = ReportRun(twin.index, twin.scored, twin.colour, same)
    return list(shown.values())


def _colour(run: ScoredRun, taken: Sequence[int]) -> int:
    """Return the colour of the flow source; another one where a run before has it already."""
    wanted = FLOW_COLOURS.get(run.experiment.flow.kind, COLOURS - 1)
    free = [k for k in range(COLOURS) if k not in taken]
    return free[0] if wanted in taken and free else wanted


@dataclass(frozen=True)
class Verdicts:
    """Which values differ significantly from those of the baseline."""

    rows: Mapping[tuple[str, MetricKey], PairedDifference] = field(default_factory=dict)
    """Title of a run and metric to the difference."""

    @classmethod
    def of(cls, differences: Sequence[RunDifferences]) -> Verdicts:
        """Collect the differences of all runs."""
        return cls({(part.run, row.key): row for part in differences for row in part.rows})

    def mark(self, run: ReportRun, key: MetricKey | None) -> str:
        """Return "better", "worse" or "": oracles, and what is not significant, have no mark."""
        row = None if key is None or run.oracle else self.rows.get((run.title, key))
        found = "" if row is None else verdict(row)
        return found if found in ("better", "worse") else ""


def verdict(row: PairedDifference) -> Verdict:
    """Say whether a run is significantly better or worse than its baseline."""
    if row.low != row.low:
        return "too few scenes"
    if row.better is None:
        return "not significant"
    return "better" if row.better else "worse"


@dataclass(frozen=True)
class Cell:
    """A value in a table."""

    text: str
    mark: str = ""
    """"better" or "worse" than the baseline, significantly; else empty."""
    under: tuple[Cell, ...] = ()
    """Secondary values, printed small below it."""


def marked_cells(
    info: MetricInfo,
    values: Sequence[float],
    runs: Sequence[ReportRun],
    verdicts: Verdicts,
    key: MetricKey | None,
) -> list[Cell]:
    """Print one value per run, with a mark where it differs significantly from the baseline."""
    return [
        Cell(info.text(value), verdicts.mark(run, key))
        for value, run in zip(values, runs, strict=True)
    ]

"""Paired differences as rows of a forest plot: the difference, its interval, whether it is real."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.eval.paired import Paired
from mottrack.pipeline.differences import RunDifferences
from mottrack.report.contest import Entrant

SHOWN = {
    ("tracking", "all"): ("AMOTA", "AMOTP", "MOTA", "MOTP", "IDS"),
    ("velocity", "all"): ("mean", "worst 5 %"),
    ("velocity", "static objects"): ("mean",),
    ("velocity", "pedestrian & cyclist"): ("mean",),
    ("velocity", "objects observed stationary"): ("mean",),
    ("velocity", "slow (0, 3] m/s"): ("mean",),
    ("velocity", "fast [3, inf) m/s"): ("mean",),
    ("flow", "dynamic"): ("RMSE",),
    ("flow", "static"): ("RMSE",),
}


@dataclass(frozen=True)
class Whisker:
    """One run's difference to the baseline, in percent of the width of its plot."""

    entrant: Entrant
    row: Paired
    low: float
    middle: float
    high: float

    @property
    def known(self) -> bool:
        """Whether there are scenes enough for an interval."""
        return self.row.low == self.row.low

    @property
    def verdict(self) -> str:
        """How it stands to the baseline: better, worse or alike; empty where it is not known."""
        return (
            {True: "better", False: "worse", None: "alike"}[self.row.better] if self.known else ""
        )

    @property
    def words(self) -> str:
        """The verdict as the table says it."""
        return WORDS[self.verdict]

    @property
    def value_text(self) -> str:
        """The run's own figure."""
        return f"{self.row.value:.3f}"

    @property
    def difference_text(self) -> str:
        """With its sign."""
        return _signed(self.row.difference)

    @property
    def interval_text(self) -> str:
        """Both ends."""
        return f"{_signed(self.row.low)} … {_signed(self.row.high)}" if self.known else "–"


WORDS = {"better": "better", "worse": "worse", "alike": "not told apart", "": "too few scenes"}


@dataclass(frozen=True)
class Group:
    """All runs' differences in one figure, on one scale."""

    name: str
    unit: str
    lower_is_better: bool
    baseline: str
    baseline_text: str
    whiskers: tuple[Whisker, ...]


def difference_groups(
    differences: Sequence[RunDifferences], entrants: Sequence[Entrant]
) -> list[Group]:
    """The leading figures in which runs were compared with their baseline."""
    by_title = {entrant.title: entrant for entrant in entrants}
    groups = []
    for baseline in dict.fromkeys(d.baseline for d in differences):
        ours = [d for d in differences if d.baseline == baseline and d.run in by_title]
        for (table, row), metrics in SHOWN.items():
            for metric in metrics:
                found = [
                    (by_title[d.run], paired)
                    for d in ours
                    for paired in d.rows
                    if (paired.key.table, paired.key.row, paired.key.metric) == (table, row, metric)
                    and paired.difference == paired.difference
                ]
                if found:
                    groups.append(_group(baseline, found))
    return groups


def _group(baseline: str, found: Sequence[tuple[Entrant, Paired]]) -> Group:
    key, value = found[0][1].key, f"{found[0][1].baseline:.3f}"
    ends = [abs(x) for _, row in found for x in (row.low, row.high, row.difference) if x == x]
    reach = max(*ends, 1e-12) * (-1.0 if key.lower_is_better else 1.0)  # better is to the right
    whiskers = tuple(
        Whisker(
            entrant,
            row,
            low=_percent(row.low, reach),
            middle=_percent(row.difference, reach),
            high=_percent(row.high, reach),
        )
        for entrant, row in found
    )
    name = key.metric if key.table == "tracking" else f"{key.table}, {key.row}: {key.metric}"
    return Group(name, key.unit, key.lower_is_better, baseline, value, whiskers)


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")


def _percent(value: float, reach: float) -> float:
    return 50.0 if value != value else 50.0 + 48.0 * value / reach

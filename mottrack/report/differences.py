"""Paired differences as rows of a forest plot: the difference, its interval, whether it is real."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.eval.paired import PairedDifference
from mottrack.report.ranking import ReportRun
from mottrack.runs.differences import RunDifferences

SHOWN = {
    ("tracking", "all", "AMOTA"): "AMOTA",
    ("tracking", "all", "AMOTP"): "AMOTP",
    ("tracking", "all", "MOTA"): "official MOTA",
    ("tracking", "all", "MOTP"): "official MOTP",
    ("tracking", "all", "IDS"): "identity switches",
    ("velocity", "all", "mean"): "velocity error (all)",
    ("velocity", "all", "worst 5 %"): "velocity error (worst 5 %)",
    (
        "velocity",
        "unlabelled tracks (assumed static)",
        "mean",
    ): "velocity error (unlabelled tracks, assumed static)",
    ("velocity", "pedestrian & cyclist", "mean"): "velocity error (pedestrian & cyclist)",
    ("velocity", "objects observed stationary", "mean"): "velocity error (stationary objects)",
    ("velocity", "slow (0, 3] m/s", "mean"): "velocity error (slow)",
    ("velocity", "fast [3, inf) m/s", "mean"): "velocity error (fast)",
    ("flow", "dynamic", "RMSE"): "flow RMSE (moving cells)",
    ("flow", "static", "RMSE"): "flow RMSE (standing cells)",
}
COUNTED = "IDS"


@dataclass(frozen=True)
class Whisker:
    """One run's difference to the baseline, in percent of the width of its plot."""

    entrant: ReportRun
    row: PairedDifference
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
        return _number(self.row, self.row.value)

    @property
    def difference_text(self) -> str:
        """With its sign."""
        return _number(self.row, self.row.difference, "+")

    @property
    def interval_text(self) -> str:
        """Both ends."""
        if not self.known:
            return "–"
        return " … ".join(_number(self.row, end, "+") for end in (self.row.low, self.row.high))


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
    differences: Sequence[RunDifferences], entrants: Sequence[ReportRun]
) -> list[Group]:
    """The leading figures in which runs were compared with their baseline."""
    by_title = {entrant.title: entrant for entrant in entrants}
    groups = []
    for baseline in dict.fromkeys(d.baseline for d in differences):
        ours = [d for d in differences if d.baseline == baseline and d.run in by_title]
        official = any(paired.key.metric == "AMOTA" for d in ours for paired in d.rows)
        for key, name in SHOWN.items():
            found = [
                (by_title[d.run], paired)
                for d in ours
                for paired in d.rows
                if (paired.key.table, paired.key.row, paired.key.metric) == key
                and paired.difference == paired.difference
            ]
            if found:
                shown = name if official else name.removeprefix("official ")
                groups.append(_group(shown, baseline, found))
    return groups


def _group(name: str, baseline: str, found: Sequence[tuple[ReportRun, PairedDifference]]) -> Group:
    key, value = found[0][1].key, _number(found[0][1], found[0][1].baseline)
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
    return Group(name, key.unit, key.lower_is_better, baseline, value, whiskers)


def _number(row: PairedDifference, value: float, sign: str = "") -> str:
    digits = 3
    if row.key.metric == COUNTED:
        digits = 0 if value.is_integer() else 1
    return f"{value:{sign}.{digits}f}".replace("-", "−")


def _percent(value: float, reach: float) -> float:
    return 50.0 if value != value else 50.0 + 48.0 * value / reach

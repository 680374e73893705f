"""Paired differences between runs as a forest plot: difference, confidence interval, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.eval.velocity_error import CATEGORIES
from mottrack.report.ranking import ReportRun, Verdict, verdict
from mottrack.runs.differences import RunDifferences

STATIC, VULNERABLE, STATIONARY, SLOW, FAST = CATEGORIES
MARGIN_PERCENT = 2.0
"""Free width at either end of the plot, so that the end of an interval is not cut off."""


class ShownDifference(NamedTuple):
    """How the page presents the differences of one metric."""

    name: str
    detail: str = ""
    """The subset of the data, in brackets after the name."""
    is_count: bool = False
    """Whether it is a count, printed without decimals."""

    @property
    def title(self) -> str:
        """Name and detail."""
        return f"{self.name} ({self.detail})" if self.detail else self.name


SHOWN = {
    MetricKey("tracking", "all", "AMOTA"): ShownDifference("AMOTA"),
    MetricKey("tracking", "all", "AMOTP"): ShownDifference("AMOTP"),
    MetricKey("tracking", "all", "MOTA"): ShownDifference("MOTA"),
    MetricKey("tracking", "all", "MOTP"): ShownDifference("MOTP"),
    MetricKey("tracking", "all", "IDS"): ShownDifference("identity switches", is_count=True),
    MetricKey("velocity", "all", "mean"): ShownDifference("velocity error", "all"),
    MetricKey("velocity", "all", "worst 5 %"): ShownDifference("velocity error", "worst 5 %"),
    MetricKey("velocity", STATIC, "mean"): ShownDifference("velocity error", "unlabelled tracks"),
    MetricKey("velocity", VULNERABLE, "mean"): ShownDifference("velocity error", VULNERABLE),
    MetricKey("velocity", STATIONARY, "mean"): ShownDifference(
        "velocity error", "stationary objects"
    ),
    MetricKey("velocity", SLOW, "mean"): ShownDifference("velocity error", "slow"),
    MetricKey("velocity", FAST, "mean"): ShownDifference("velocity error", "fast"),
    MetricKey("flow", "dynamic", "RMSE"): ShownDifference("flow RMSE", "dynamic cells"),
    MetricKey("flow", "static", "RMSE"): ShownDifference("flow RMSE", "static cells"),
}


@dataclass(frozen=True)
class Whisker:
    """The difference of one run to the baseline and its interval, on the scale of the plot."""

    run: ReportRun
    row: PairedDifference
    shown: ShownDifference
    percent_per_unit: float
    """Width of the plot per unit of the metric; negative where lower is better."""

    @property
    def verdict(self) -> Verdict:
        """Whether the difference is significant."""
        return verdict(self.row)

    def place(self, difference: float) -> float:
        """Return the place of a difference in per cent of the plot's width."""
        return 50.0 + self.percent_per_unit * difference

    def number(self, value: float, sign: str = "") -> str:
        """Print a value of the metric, with its sign if ``sign`` is ``"+"``."""
        digits = 3 if not self.shown.is_count else 0 if value.is_integer() else 1
        return f"{value:{sign}.{digits}f}".replace("-", "−")


@dataclass(frozen=True)
class Group:
    """The differences of all runs in one metric, on one scale."""

    shown: ShownDifference
    baseline: str
    whiskers: tuple[Whisker, ...]

    @property
    def significant(self) -> bool:
        """Whether any run differs from the baseline; oracles do not count."""
        found = [w.verdict for w in self.whiskers if not w.run.oracle]
        return any(v in ("better", "worse") for v in found)


def difference_groups(
    differences: Sequence[RunDifferences], runs: Sequence[ReportRun]
) -> list[Group]:
    """Group the differences to each baseline by metric: significant ones first, else as `SHOWN`.

    Where clusters are tracked velocity and flow come first: their tracking metrics count walls.
    """
    order = list(SHOWN.items())
    if any(run.clusters for run in runs):
        order.sort(key=lambda item: item[0].table == "tracking")
    groups = []
    for baseline in dict.fromkeys(d.baseline for d in differences):
        rows = {
            (row.key, d.run): row
            for d in differences
            if d.baseline == baseline
            for row in d.rows
            if row.difference == row.difference
        }
        for key, shown in order:
            found = {run: row for (k, run), row in rows.items() if k == key}
            if whiskers := _whiskers(shown, found, runs):
                groups.append(Group(shown, baseline, whiskers))
    return sorted(groups, key=lambda group: not group.significant)


def _whiskers(
    shown: ShownDifference, rows: dict[str, PairedDifference], runs: Sequence[ReportRun]
) -> tuple[Whisker, ...]:
    """Scale the plot to the furthest interval; better is to the right."""
    ends = [abs(x) for row in rows.values() for x in (row.low, row.high, row.difference) if x == x]
    furthest = max([*ends, 1e-12])  # against a division by zero where all differences are zero
    scale = (50.0 - MARGIN_PERCENT) / furthest
    return tuple(
        Whisker(run, row, shown, -scale if row.key.lower_is_better else scale)
        for run in runs
        if (row := rows.get(run.title)) is not None
    )

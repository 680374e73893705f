"""Summary of a comparison: significant findings, and a card per leading metric."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mottrack.eval.metric_info import FLOW, TRACKING, VELOCITY, MetricInfo
from mottrack.eval.paired import MetricKey
from mottrack.report.analysis import Analysis
from mottrack.report.differences import FAST, SHOWN, STATIC, Group, ShownDifference
from mottrack.report.ranking import NAN, ReportRun, Verdicts
from mottrack.report.timing import TIMING

Value = Callable[[ReportRun, Analysis], float]
INFO = {info.key: info for info in (*TRACKING, *VELOCITY, *FLOW)}
WORST_SHARE = 0.15
"""Length of the bar of the worst run: long enough to be seen."""


@dataclass(frozen=True)
class SummaryMetric:
    """A metric that the summary shows."""

    info: MetricInfo
    shown: ShownDifference
    value: Value
    difference: MetricKey | None = None
    """Under which its differences to the baseline are listed; None where there are none."""


@dataclass(frozen=True)
class Bar:
    """The value of one run."""

    run: ReportRun
    text: str
    share: float
    """Length of its bar, 0 to 1: the longer the better, whatever the metric's direction."""
    mark: str
    """"better" or "worse" than the baseline, significantly; else empty."""


@dataclass(frozen=True)
class MetricCard:
    """One metric with the values of all runs."""

    metric: SummaryMetric
    bars: tuple[Bar, ...]


def _tracking(key: str, difference: MetricKey | None = None) -> SummaryMetric:
    def value(run: ReportRun, _: Analysis) -> float:
        return run.scored.scores.overall.as_dict().get(key, NAN)

    return SummaryMetric(INFO[key], ShownDifference(INFO[key].name), value, difference)


def _velocity(row: str) -> SummaryMetric:
    def value(run: ReportRun, _: Analysis) -> float:
        return run.scored.velocity_error(row).mean_mps

    key = MetricKey("velocity", row, "mean")
    return SummaryMetric(INFO["mean_mps"], SHOWN[key], value, key)


def _flow(run: ReportRun, _: Analysis) -> float:
    error = run.scored.scores.flow.get("dynamic")
    return NAN if error is None else error.rmse_mps


def _time(_: ReportRun, analysis: Analysis) -> float:
    return NAN if analysis.timing is None else analysis.timing.median_ms


FLOW_KEY = MetricKey("flow", "dynamic", "RMSE")
TRACKED = (
    _tracking("amota", MetricKey("tracking", "all", "AMOTA")),
    _tracking("mota", MetricKey("tracking", "all", "MOTA")),
    _tracking("idf1"),
)
MEASURED = (
    _velocity("all"),
    _velocity(STATIC),
    _velocity(FAST),
    SummaryMetric(INFO["rmse_mps"], SHOWN[FLOW_KEY], _flow, FLOW_KEY),
)
TIME = SummaryMetric(TIMING, ShownDifference(TIMING.name), _time)


def metric_cards(
    runs: Sequence[ReportRun], analyses: Sequence[Analysis], verdicts: Verdicts
) -> list[MetricCard]:
    """Return a card per metric that any run has a value of; without truth that is time alone.

    Where clusters are tracked velocity and flow come first.
    """
    clusters = any(run.clusters for run in runs)
    scored = (*MEASURED, *TRACKED) if clusters else (*TRACKED, *MEASURED)
    metrics = (*scored, TIME) if any(run.has_truth for run in runs) else (TIME,)
    cards = []
    for metric in metrics:
        values = [metric.value(run, a) for run, a in zip(runs, analyses, strict=True)]
        if any(value == value for value in values):
            cards.append(_card(metric, values, runs, verdicts))
    return cards


def _card(
    metric: SummaryMetric,
    values: Sequence[float],
    runs: Sequence[ReportRun],
    verdicts: Verdicts,
) -> MetricCard:
    known = [value for value in values if value == value]
    best = 0.0 if metric.info.lower_is_better else 1.0
    worst = max(known) if metric.info.lower_is_better else min([0.0, *known])
    bars = [
        Bar(run, metric.info.text(v), share(v, best, worst), verdicts.mark(run, metric.difference))
        for run, v in zip(runs, values, strict=True)
    ]
    return MetricCard(metric, tuple(bars))


def share(value: float, best: float, worst: float) -> float:
    """Return the length of a bar: 1 for a perfect value, `WORST_SHARE` for the worst one."""
    if value != value:
        return 0.0
    if best == worst:
        return 1.0
    return WORST_SHARE + (1.0 - WORST_SHARE) * (value - worst) / (best - worst)


def findings(groups: Sequence[Group]) -> list[str]:
    """Say which differences are significant: a sentence for each run, better ones first."""
    texts = []
    for baseline in dict.fromkeys(group.baseline for group in groups):
        found: dict[tuple[str, str], list[ShownDifference]] = {}
        known = False
        for group in groups:
            for w in group.whiskers if group.baseline == baseline else ():
                known |= w.verdict != "too few scenes"
                if w.verdict in ("better", "worse") and not w.run.oracle:
                    found.setdefault((w.run.title, w.verdict), []).append(group.shown)
        if not known:
            texts.append(f"Against {baseline}: too few scenes for a confidence interval.")
        elif not found:
            texts.append(f"Against {baseline}: no significant difference in any metric.")
        for (run, word), shown in sorted(found.items(), key=lambda item: item[0][1]):
            texts.append(f"{run} is significantly {word} than {baseline} in {_listed(shown)}.")
    return texts


def _listed(metrics: Sequence[ShownDifference]) -> str:
    """List metrics in one phrase: "AMOTA and flow RMSE (dynamic cells, static cells)"."""
    details: dict[str, list[str]] = {}
    for metric in metrics:
        details.setdefault(metric.name, []).extend([metric.detail] if metric.detail else [])
    told = [f"{name} ({', '.join(parts)})" if parts else name for name, parts in details.items()]
    return told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"

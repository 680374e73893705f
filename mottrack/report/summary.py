"""Summary of a comparison: a card per leading metric, the best runs, significant differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mottrack.eval.metric_info import FLOW, TRACKING, VELOCITY, MetricInfo
from mottrack.eval.paired import MetricKey
from mottrack.report.analysis import Analysis
from mottrack.report.differences import FAST, SHOWN, STATIC, Group, ShownDifference, verdict
from mottrack.report.ranking import NAN, ReportRun, ranked_cells
from mottrack.report.timing import TIMING
from mottrack.runs.differences import RunDifferences

Value = Callable[[ReportRun, Analysis], float]
INFO = {info.key: info for info in (*TRACKING, *VELOCITY, *FLOW)}


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
    """Length of its bar, 0 to 1."""
    best: bool


@dataclass(frozen=True)
class MetricCard:
    """One metric with the values of all runs."""

    metric: SummaryMetric
    bars: tuple[Bar, ...]
    sentence: str
    """Which runs differ significantly from the baseline; empty where that is not known."""


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
SCORED = (
    _tracking("amota", MetricKey("tracking", "all", "AMOTA")),
    _tracking("mota"),
    _tracking("idf1"),
    _velocity("all"),
    _velocity(STATIC),
    _velocity(FAST),
    SummaryMetric(INFO["rmse_mps"], SHOWN[FLOW_KEY], _flow, FLOW_KEY),
)
TIME = SummaryMetric(TIMING, ShownDifference(TIMING.name), _time)


def metric_cards(
    runs: Sequence[ReportRun],
    analyses: Sequence[Analysis],
    differences: Sequence[RunDifferences],
) -> list[MetricCard]:
    """Return a card per metric that any run has a value of; without truth that is time alone."""
    metrics = (*SCORED, TIME) if any(run.has_truth for run in runs) else (TIME,)
    cards = []
    for metric in metrics:
        values = [metric.value(run, a) for run, a in zip(runs, analyses, strict=True)]
        if any(value == value for value in values):
            sentence = _sentence(metric, runs, differences)
            cards.append(MetricCard(metric, _bars(metric, values, runs), sentence))
    return cards


def _bars(
    metric: SummaryMetric, values: Sequence[float], runs: Sequence[ReportRun]
) -> tuple[Bar, ...]:
    longest = max((value for value in values if value == value), default=0.0)
    bars = []
    for run, value, cell in zip(runs, values, ranked_cells(metric.info, values, runs), strict=True):
        share = max(value, 0.0) / longest if longest > 0 and value == value else 0.0
        bars.append(Bar(run, cell.text, share, cell.best))
    return tuple(bars)


def _sentence(
    metric: SummaryMetric, runs: Sequence[ReportRun], differences: Sequence[RunDifferences]
) -> str:
    verdicts: dict[str, list[str]] = {words: [] for words in WORDS.values()}
    for run in runs:
        rows = [r for d in differences if d.run == run.title for r in d.rows]
        row = next((r for r in rows if r.key == metric.difference), None)
        if row is not None and not run.oracle and (found := verdict(row)) in WORDS:
            verdicts[WORDS[found]].append(run.title)
    told = [f"{', '.join(titles)} {words}" for words, titles in verdicts.items() if titles]
    baselines = ", ".join(dict.fromkeys(d.baseline for d in differences))
    return f"Against {baselines}: {'; '.join(told)}." if told else ""


WORDS = {
    "better": "significantly better",
    "worse": "significantly worse",
    "not significant": "not significantly different",
}


def headlines(cards: Sequence[MetricCard], groups: Sequence[Group]) -> list[str]:
    """Say which runs have the best values, and which differences are significant."""
    best: dict[str, list[ShownDifference]] = {}
    for card in cards:
        for bar in card.bars:
            if bar.best:
                best.setdefault(bar.run.title, []).append(card.metric.shown)
    told = [f"{title} in {_listed(metrics)}" for title, metrics in best.items()]
    return ([f"Best values: {'; '.join(told)}."] if told else []) + _findings(groups)


def _findings(groups: Sequence[Group]) -> list[str]:
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
            continue
        told = [f"{run} is {word} in {_listed(shown)}" for (run, word), shown in found.items()]
        words = "; ".join(told) if told else "no difference in any metric"
        texts.append(f"Significant at 95 %, against {baseline}: {words}.")
    return texts


def _listed(metrics: Sequence[ShownDifference]) -> str:
    """List metrics in one phrase: "AMOTA and flow RMSE (dynamic cells, static cells)"."""
    details: dict[str, list[str]] = {}
    for metric in metrics:
        details.setdefault(metric.name, []).extend([metric.detail] if metric.detail else [])
    told = [f"{name} ({', '.join(parts)})" if parts else name for name, parts in details.items()]
    return told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"

"""What came of it, before any table: the leading figures, who is best, what is real."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mottrack.eval.paired import PairedDifference
from mottrack.report.analysis import Analysis
from mottrack.report.differences import Group
from mottrack.report.measures import FLOW, TIMING, TRACKING, VELOCITY, Measure
from mottrack.report.ranking import ReportRun, best_of
from mottrack.runs.differences import RunDifferences

NAN = float("nan")
Value = Callable[[ReportRun, Analysis], float]


@dataclass(frozen=True)
class SummaryMetric:
    """A figure that the summary shows."""

    measure: Measure
    title: str
    value: Value
    difference: tuple[str, str, str] | None
    """Table, row and metric under which its differences are listed; None where there are none."""


@dataclass(frozen=True)
class Bar:
    """One run's answer."""

    entrant: ReportRun
    text: str
    share: float
    """Length of its bar, 0 to 1."""
    best: bool
    verdict: str
    """"better", "worse" or "alike" beside the baseline; empty where that was not asked."""


@dataclass(frozen=True)
class Card:
    """One question and every run's answer."""

    question: SummaryMetric
    bars: tuple[Bar, ...]
    sentence: str


def _of_class(key: str) -> Value:
    return lambda entrant, _: entrant.run.scores.overall.as_dict().get(key, NAN)


def _velocity(row: str) -> Value:
    return lambda entrant, _: entrant.run.velocity_error(row).mean_mps


def _flow(entrant: ReportRun, _: Analysis) -> float:
    error = entrant.run.scores.flow.get("dynamic")
    return NAN if error is None else error.rmse_mps


def _time(_: ReportRun, analysis: Analysis) -> float:
    return NAN if analysis.timing is None else analysis.timing.median_ms


BY_KEY = {measure.key: measure for measure in (*TRACKING, *VELOCITY, *FLOW)}
QUESTIONS = (
    SummaryMetric(BY_KEY["amota"], "AMOTA", _of_class("amota"), ("tracking", "all", "AMOTA")),
    SummaryMetric(BY_KEY["mota"], "MOTA", _of_class("mota"), None),
    SummaryMetric(BY_KEY["idf1"], "IDF1", _of_class("idf1"), None),
    SummaryMetric(
        BY_KEY["mean_mps"], "velocity error (all)", _velocity("all"), ("velocity", "all", "mean")
    ),
    SummaryMetric(
        BY_KEY["mean_mps"],
        "velocity error (unlabelled tracks, assumed static)",
        _velocity("unlabelled tracks (assumed static)"),
        ("velocity", "unlabelled tracks (assumed static)", "mean"),
    ),
    SummaryMetric(
        BY_KEY["mean_mps"],
        "velocity error (fast)",
        _velocity("fast [3, inf) m/s"),
        ("velocity", "fast [3, inf) m/s", "mean"),
    ),
    SummaryMetric(
        BY_KEY["rmse_mps"], "flow RMSE (moving cells)", _flow, ("flow", "dynamic", "RMSE")
    ),
    SummaryMetric(TIMING, "time a key frame", _time, None),
)


def cards(
    entrants: Sequence[ReportRun],
    analyses: Sequence[Analysis],
    differences: Sequence[RunDifferences],
) -> list[Card]:
    """Every question that any run has an answer to; without truth that is the time alone."""
    has_truth = any(entrant.has_truth for entrant in entrants)
    asked = [q for q in QUESTIONS if has_truth or q.measure is TIMING]
    made = [_card(question, entrants, analyses, differences) for question in asked]
    return [card for card in made if any(bar.text != "–" for bar in card.bars)]


def _card(
    question: SummaryMetric,
    entrants: Sequence[ReportRun],
    analyses: Sequence[Analysis],
    differences: Sequence[RunDifferences],
) -> Card:
    values = [question.value(e, a) for e, a in zip(entrants, analyses, strict=True)]
    best = best_of(question.measure, values, entrants)
    longest = max((v for v in values if v == v), default=0.0)
    bars = tuple(
        Bar(
            entrant=entrant,
            text=question.measure.text(value),
            share=max(value, 0.0) / longest if longest > 0 and value == value else 0.0,
            best=best[k],
            verdict=_verdict(question, entrant, differences),
        )
        for k, (entrant, value) in enumerate(zip(entrants, values, strict=True))
    )
    return Card(question, bars, _sentence(bars, differences))


def _verdict(
    question: SummaryMetric, entrant: ReportRun, differences: Sequence[RunDifferences]
) -> str:
    pair = next((d for d in differences if d.run == entrant.title), None)
    row = None if pair is None else _row(pair.rows, question.difference)
    if row is None or row.low != row.low:
        return ""
    return {True: "better", False: "worse", None: "alike"}[row.better]


def _row(
    rows: Sequence[PairedDifference], wanted: tuple[str, str, str] | None
) -> PairedDifference | None:
    named = {(row.key.table, row.key.row, row.key.metric): row for row in rows}
    return None if wanted is None else named.get(wanted)


def _sentence(bars: Sequence[Bar], differences: Sequence[RunDifferences]) -> str:
    rivals = [bar for bar in bars if bar.verdict and not bar.entrant.oracle]
    if not rivals:
        return ""
    baselines = dict.fromkeys(d.baseline for d in differences)
    told = [
        f"{', '.join(bar.entrant.title for bar in rivals if bar.verdict == verdict)} {words}"
        for verdict, words in WORDS.items()
        if any(bar.verdict == verdict for bar in rivals)
    ]
    return f"Against {', '.join(baselines)}: {'; '.join(told)}."


WORDS = {
    "better": "really better",
    "worse": "really worse",
    "alike": "not told apart from it by these scenes",
}


def headlines(made: Sequence[Card], groups: Sequence[Group]) -> list[str]:
    """Who has the best figures, and which differences the scenes bear out."""
    return [text for text in (_winners(made), *_findings(groups)) if text]


def _winners(made: Sequence[Card]) -> str:
    won: dict[str, list[str]] = {}
    for card in made:
        for bar in card.bars:
            if bar.best:
                won.setdefault(bar.entrant.title, []).append(card.question.title)
    told = [f"{title} in {_listed(names)}" for title, names in won.items()]
    return f"Best figures: {'; '.join(told)}." if told else ""


def _findings(groups: Sequence[Group]) -> list[str]:
    texts = []
    for baseline in dict.fromkeys(group.baseline for group in groups):
        ours = [group for group in groups if group.baseline == baseline]
        found: dict[tuple[str, str], list[str]] = {}
        for group in ours:
            for w in group.whiskers:
                if w.verdict in ("better", "worse") and not w.entrant.oracle:
                    found.setdefault((w.entrant.title, w.verdict), []).append(group.name)
        told = [f"{run} is {verdict} in {_listed(n)}" for (run, verdict), n in found.items()]
        if not any(w.known for group in ours for w in group.whiskers):
            texts.append(f"Against {baseline}: too few scenes to tell a difference from chance.")
            continue
        words = "; ".join(told) if told else "no difference in any figure"
        texts.append(f"Borne out by the scenes (95 %), against {baseline}: {words}.")
    return texts


def _listed(names: Sequence[str]) -> str:
    """In one phrase; "flow (a)" and "flow (b)" become "flow (a, b)"."""
    inner: dict[str, list[str]] = {}
    for name in names:
        stem, _, detail = name.removesuffix(")").partition(" (")
        inner.setdefault(stem, []).extend([detail] if detail else [])
    told = [f"{stem} ({', '.join(parts)})" if parts else stem for stem, parts in inner.items()]
    return told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"

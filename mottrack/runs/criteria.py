"""Verdicts on the criteria of an experiment, from the intervals of what flow was worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from mottrack.eval.velocity_value import Value
from mottrack.experiment.criteria import Criterion
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.runs.velocity_bench import FlowValue, metric_key

Verdict = Literal["met", "undecided", "failed", "not measured"]
MEANING: dict[Verdict, str] = {
    "met": "the whole 95 % interval meets the bound that was written before the run",
    "undecided": "some values of the interval meet it and some do not, or there is one scene only",
    "failed": "no value of the interval meets it",
    "not measured": "a run or a metric is missing, or the gain of the true flow is not significant",
}


@dataclass(frozen=True)
class Judged:
    """A criterion and its verdict."""

    criterion: Criterion
    verdict: Verdict
    reason: str = ""
    """Why it was not measured; empty where it was."""
    value: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")

    @property
    def figures(self) -> str:
        """The value with its interval, as text."""
        number = self.criterion.number
        if self.value != self.value:
            return self.reason
        if self.low != self.low:
            return f"{number(self.value)} (one scene)"
        return f"{number(self.value)} [{number(self.low)}, {number(self.high)}]"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        numbers = {"value": self.value, "low": self.low, "high": self.high}
        return {
            "claim": self.criterion.claim,
            "run": self.criterion.run,
            "bound": self.criterion.bound,
            "verdict": self.verdict,
            "reason": self.reason,
            **strict(numbers),
        }

    @property
    def text(self) -> str:
        """Verdict, claim, bound and figures in one line."""
        found = f", found {self.figures}" if self.value == self.value else f"; {self.reason}"
        return f"{self.verdict}: {self.criterion.claim} ({self.criterion.bound}{found})"


def judge(criteria: Sequence[Criterion], values: Sequence[FlowValue]) -> list[Judged]:
    """Return the verdict on each criterion."""
    return [_judged(criterion, values) for criterion in criteria]


def _judged(criterion: Criterion, values: Sequence[FlowValue]) -> Judged:
    value = next((v for v in values if v.run == criterion.run), None)
    if value is None:
        runs = ", ".join(v.run for v in values) or "none"
        reason = f"no run {criterion.run} beside one without flow; there are: {runs}"
        return Judged(criterion, "not measured", reason)
    found = _measured(criterion, value)
    if found is None:
        return Judged(criterion, "not measured", _missing(criterion, value))
    if found.low != found.low:
        return Judged(criterion, "undecided", value=found.share)
    both = criterion.holds(found.low), criterion.holds(found.high)
    verdict: Verdict = "met" if all(both) else "undecided" if any(both) else "failed"
    return Judged(criterion, verdict, "", found.share, found.low, found.high)


def _missing(criterion: Criterion, value: FlowValue) -> str:
    """Return why a run has no such figure."""
    if criterion.measure != "share of headroom":
        return f"{criterion.run} or {value.baseline} has no {criterion.metric}"
    if value.oracle:
        return f"{criterion.run} is the true flow itself"
    return "no run with the true flow, or its gain is not significant"


def _measured(criterion: Criterion, value: FlowValue) -> Value | None:
    """Return what a criterion bounds, with its interval; None where it was not measured."""
    if criterion.measure == "share of headroom":
        return next((s for s in value.shares if s.metric == criterion.metric), None)
    key = metric_key(criterion.metric, criterion.objects)
    if criterion.measure == "relative change":
        return value.changes.get(key)
    row = value.row(key)
    return None if row is None else Value(criterion.metric, row.difference, row.low, row.high)


def criteria_table(judged: Sequence[Judged]) -> TextTable:
    """Tabulate criteria and verdicts."""
    rows: list[tuple[Cell, ...]] = [
        (j.criterion.claim, j.criterion.run, j.criterion.bound, j.figures or None, j.verdict)
        for j in judged
    ]
    columns = tuple(Column(name) for name in ("claim", "run", "bound", "found", "verdict"))
    note = "; ".join(f"{name}: {text}" for name, text in MEANING.items())
    return TextTable("criteria", "Criteria written before the run", columns, tuple(rows), note)


def unmet(judged: Sequence[Judged]) -> Iterator[str]:
    """Yield the number of criteria that are met, then every other one in a line, failed first."""
    if not judged:
        return
    count = sum(j.verdict == "met" for j in judged)
    yield f"Criteria written before the run: {count} of {len(judged)} met."
    for verdict in ("failed", "undecided", "not measured"):
        yield from (one.text for one in judged if one.verdict == verdict)

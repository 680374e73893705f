"""Claims of the paper and the verdict of our runs on them, from confidence intervals alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.eval.velocity_error import OTHER
from mottrack.formats.strict_json import strict
from mottrack.paper.published import EQUAL, LABELS, NONE, PILLARFLOW, TABLES, Published

Verdict = Literal["reproduced", "not reproduced", "reversed", "undecided", "not measured"]
MEANING: dict[Verdict, str] = {
    "reproduced": "the difference has the sign of the paper and its 95 % interval excludes zero",
    "reversed": "it has the opposite sign and its interval excludes zero",
    "not reproduced": "the interval contains zero and excludes the relative difference of the "
    "paper",
    "undecided": "the interval contains both zero and the relative difference of the paper, or "
    "there is only one scene",
    "not measured": "a run or a metric is missing; see the note of the table",
}


@dataclass(frozen=True)
class Claim:
    """The claim that one method has a lower, or a higher, metric than another."""

    table: str
    source: str
    study: str
    heading: str
    key: MetricKey
    subject: str
    """Variant that the claim is about."""
    rival: str
    lower: bool
    """Whether the subject is claimed to have the lower value."""
    published: tuple[float, float] | None = None
    """What the paper prints for subject and rival; None for a claim in words."""
    digits: int = 3
    """Printed digits after the decimal point."""

    @property
    def text(self) -> str:
        """The claim in a sentence."""
        rival = "no velocities" if self.rival == NONE else LABELS[self.rival]
        word = "lower" if self.lower else "higher"
        return f"{self.heading}: {LABELS[self.subject]} {word} than {rival}"

    @property
    def printed(self) -> str:
        """Text of what the paper prints for subject and rival."""
        if self.published is None:
            return "in words"
        return ", ".join(f"{value:.{self.digits}f}" for value in self.published)

    @property
    def favours_pillarflow(self) -> bool:
        """Whether it says that PillarFlow is better; some tables of the paper say the opposite."""
        ours = self.subject in (PILLARFLOW, EQUAL)
        return ours and self.lower == self.key.lower_is_better


@dataclass(frozen=True)
class Finding:
    """A claim and its verdict on one data set."""

    claim: Claim
    dataset: str
    verdict: Verdict
    paired: PairedDifference | None = None
    """Difference of the subject to the rival; None where a run is missing."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for claims.json."""
        claim, found = self.claim, self.paired
        plain: dict[str, Any] = {
            "claim": claim.text,
            "source": claim.source,
            "dataset": self.dataset,
            "verdict": self.verdict,
            "published": claim.published,
            "unit": claim.key.unit,
        }
        if found is None:
            return plain
        numbers = {
            "rival": found.baseline,
            "subject": found.value,
            "difference": found.difference,
            "low": found.low,
            "high": found.high,
        }
        return {**plain, **strict(numbers), "scenes": found.scenes}


def claims() -> list[Claim]:
    """Return every comparison that the tables of the paper make, then the claim in words."""
    return [*(claim for table in TABLES for claim in _claims_of(table)), _UNKNOWN_OBJECTS]


def verdict_of(claim: Claim, found: PairedDifference | None) -> Verdict:
    """Test a claim against the paired difference of subject minus rival."""
    if found is None:
        return "not measured"
    if found.low != found.low:
        return "undecided"
    if found.significant:
        return "reproduced" if (found.difference < 0.0) == claim.lower else "reversed"
    if claim.published is None:
        return "undecided"
    subject, rival = claim.published
    expected = found.baseline * (subject / rival - 1.0)
    return "undecided" if found.low <= expected <= found.high else "not reproduced"


def _claims_of(table: Published) -> Iterator[Claim]:
    for subject, rival in table.pairs:
        for column, (heading, key) in enumerate(table.columns):
            ours, theirs = table.printed(subject, column), table.printed(rival, column)
            if ours is None or theirs is None or ours == theirs:
                continue
            yield Claim(
                table=table.number,
                source=table.source,
                study=table.study,
                heading=heading,
                key=key,
                subject=subject,
                rival=rival,
                lower=ours < theirs,
                published=(ours, theirs),
                digits=table.digits,
            )


_UNKNOWN_OBJECTS = Claim(
    table="V-D",
    source="Section V-D and Metric 5 (a thrown ball), in words",
    study="velocity",
    heading="unknown objects, mean velocity error",
    key=MetricKey("velocity", OTHER, "mean", "m/s"),
    subject=PILLARFLOW,
    rival=NONE,
    lower=True,
)

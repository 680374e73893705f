"""What the paper claims, and whether our runs bear it out: decided by the interval alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.eval.velocity_error import OTHER
from mottrack.paper.published import LABELS, NONE, PILLARFLOW, TABLES, Published

Verdict = Literal["reproduced", "not reproduced", "reversed", "undecided", "not measured"]
VERDICTS: tuple[Verdict, ...] = (
    "reproduced",
    "reversed",
    "not reproduced",
    "undecided",
    "not measured",
)
MEANING = {
    "reproduced": "the difference has the paper's sign and its 95 % interval excludes zero",
    "reversed": "it has the other sign and its interval excludes zero",
    "not reproduced": "the interval holds zero, and is narrow enough to exclude a relative "
    "difference as large as the paper's",
    "undecided": "the interval holds zero and the paper's relative difference alike, or there is "
    "one scene only",
    "not measured": "a run or a figure is missing; the note under its table says why",
}


@dataclass(frozen=True)
class Claim:
    """The paper says that one method's figure is lower, or higher, than another's."""

    table: str
    source: str
    study: str
    heading: str
    key: MetricKey
    subject: str
    """Variant that the claim is about."""
    rival: str
    lower: bool
    """Whether the subject's figure is said to be the lower one."""
    published: tuple[float, float] | None = None
    """What the paper prints for subject and rival; None where it only says so."""
    digits: int = 3
    """Behind the point, in print."""

    @property
    def text(self) -> str:
        """The claim in a sentence."""
        rival = "no velocities" if self.rival == NONE else LABELS[self.rival]
        word = "lower" if self.lower else "higher"
        return f"{self.heading}: {LABELS[self.subject]} {word} than {rival}"

    @property
    def printed(self) -> str:
        """What the paper prints for subject and rival, as people read it."""
        if self.published is None:
            return "in words"
        return ", ".join(f"{value:.{self.digits}f}" for value in self.published)

    @property
    def praises(self) -> bool:
        """Whether it says that PillarFlow is the better one; the paper's tables concede some."""
        return self.subject == PILLARFLOW and self.lower == self.key.lower_is_better


@dataclass(frozen=True)
class Finding:
    """A claim and what became of it on one data set."""

    claim: Claim
    dataset: str
    verdict: Verdict
    paired: PairedDifference | None = None
    """The subject against the rival; None where a run is missing."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for claims.json."""
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
        finite = {name: None if x != x else x for name, x in numbers.items()}
        return {**plain, **finite, "scenes": found.scenes}


def claims() -> list[Claim]:
    """Every comparison that the paper's tables make, then what it says without figures."""
    return [*(claim for table in TABLES for claim in _claims_of(table)), _UNKNOWN_OBJECTS]


def judge(claim: Claim, found: PairedDifference | None) -> Verdict:
    """Holds a claim against the paired difference of subject minus rival."""
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
        for column, (heading, key) in enumerate(table.figures):
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
    heading="movers that no detector knows, mean velocity error",
    key=MetricKey("velocity", OTHER, "mean", "m/s"),
    subject=PILLARFLOW,
    rival=NONE,
    lower=True,
)

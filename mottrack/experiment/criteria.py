"""Criteria of an experiment: what is claimed of its runs, written before they run."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mottrack.config import StrictModel


class Criterion(StrictModel):
    """One claim about a run beside the run without flow of the same tracker and objects.

    The figures are those of the table `flow_value`: over the (object, frame) rows that all these
    runs have, with intervals over scenes. A criterion is part of a run's configuration, so one that
    is changed after the run belongs to another run.
    """

    claim: str = Field(min_length=1, description="the claim in words")
    run: str = Field(min_length=1, description="title of the run that it is made of")
    metric: Literal["velocity error", "1 s prediction", "AMOTA", "identity switches"] = Field(
        description="of the table flow_value"
    )
    objects: Literal[
        "all", "stationary", "slow", "fast", "age 1", "age 2", "age 3", "age 4", "age over 4"
    ] = Field("all", description="whose velocity error")
    measure: Literal["share of headroom", "relative change", "difference"] = Field(
        description="share of the gain of the true flow, or change against no flow"
    )
    at_least: float | None = Field(None, description="lower bound of the claim")
    at_most: float | None = Field(None, description="upper bound of the claim")

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if (self.at_least is None) == (self.at_most is None):
            raise ValueError("one of at_least and at_most")
        if self.objects != "all" and (
            self.metric != "velocity error" or self.measure == "share of headroom"
        ):
            raise ValueError("objects only of a change of the velocity error")
        return self

    @property
    def bound(self) -> str:
        """The bound in words, shares and relative changes in per cent."""
        word = "at least" if self.at_least is not None else "at most"
        value = float((self.at_least if self.at_least is not None else self.at_most) or 0.0)
        return f"{word} {f'{value:g}' if self.measure == 'difference' else self.number(value)}"

    def number(self, value: float) -> str:
        """Return a value of its measure as text."""
        if self.measure == "share of headroom":
            return f"{value:.0%}"
        return f"{value:+.0%}" if self.measure == "relative change" else f"{value:+.3f}"

    def holds(self, value: float) -> bool:
        """Return whether a value meets the bound."""
        if self.at_least is not None:
            return value >= self.at_least
        return self.at_most is not None and value <= self.at_most

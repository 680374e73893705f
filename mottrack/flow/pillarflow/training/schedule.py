"""Learning rates over a run."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel


class ScheduleConfig(StrictModel):
    """How the learning rate moves from the first to the last step."""

    kind: Literal["cosine", "trapezoid", "exponential"] = Field(
        "trapezoid",
        description="trapezoid: flat, then linear to zero; exponential: the paper's 0.9 a tenth",
    )
    warm_up_steps: int = Field(50, ge=0, description="linear rise from zero")
    decay_share: float = Field(0.3, gt=0, le=1, description="falling part of a trapezoid")


def rate(config: ScheduleConfig, step: int, steps: int) -> float:
    """Share of the full learning rate at `step` of `steps`."""
    if step < config.warm_up_steps:
        return (step + 1) / config.warm_up_steps
    progress = min(step / max(steps, 1), 1.0)
    if config.kind == "exponential":
        return float(0.9 ** math.floor(10 * progress))
    if config.kind == "cosine":
        return 0.5 * (1.0 + math.cos(math.pi * progress))
    return min(1.0, (1.0 - progress) / config.decay_share)

"""Which components move: their best shift must explain clearly more than rest does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.matcher import Labels, Matches


class VerdictConfig(StrictModel):
    """When a shift is believed."""

    max_ratio: float = Field(
        0.7, gt=0, le=1, description="cost of the shift over the cost of rest, at most"
    )
    advantage_m: float = Field(0.02, ge=0, description="cost of rest less that of the shift")
    worst_cost_m: float = Field(0.2, gt=0, description="a shift that fits no better is refused")
    min_points: int = Field(12, ge=1, description="with fewer points a far shift fits anywhere")
    min_points_near: int = Field(6, ge=1, description="fewer than this are never believed")
    near_m: float = Field(0.5, gt=0, description="a shift within ICP's own reach from rest")


@dataclass(frozen=True, slots=True)
class Judged:
    """Components, what was found for each, and which of them move."""

    labels: Labels
    matches: Matches
    moving: NDArray[np.bool_]
    """(K,) components whose shift is believed; the others rest or were not seen before."""


def is_moving(matches: Matches, config: VerdictConfig) -> NDArray[np.bool_]:
    """(K,) components whose shift is believed."""
    believed = explains(matches, config)
    far = np.hypot(matches.shift_m[:, 0], matches.shift_m[:, 1]) > config.near_m
    needed = np.where(far, config.min_points, config.min_points_near)
    return believed & (matches.points >= needed)


def explains(matches: Matches, config: VerdictConfig) -> NDArray[np.bool_]:
    """(K,) components whose shift leaves clearly less unexplained than rest, and little."""
    clear = matches.cost_m < config.max_ratio * matches.rest_cost_m
    clear &= matches.rest_cost_m - matches.cost_m > config.advantage_m
    return clear & (matches.cost_m < config.worst_cost_m)

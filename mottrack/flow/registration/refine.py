"""Geometric verification and refinement of a flow field.

The cells that a field claims to move form components of similar velocity. The points of each are
registered to several past sweeps, starting from the component's median velocity, and the motions
fused with the claim (`motions`). A motion is withdrawn where it is likelier that the component
rests, and no longer valid where the points are too few to tell. This is decided by component: cell
by cell, the side of a car would be at rest, since it slides along itself.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Floats
from mottrack.core.motion import FlowField
from mottrack.flow.registration.components import (
    Similar,
    medians_of_spans,
    moving_cells,
    owners_of_fragments,
)
from mottrack.flow.registration.matcher import CompareConfig, CurrentPoints, Labels
from mottrack.flow.registration.motions import (
    MIN_POINTS,
    Claims,
    ComponentMotions,
    component_motions,
)
from mottrack.flow.sweep_pair import PastSweep, SweepPair


class RefineConfig(StrictModel):
    """Which cells count as moving, and how their components are tested."""

    match: CompareConfig = Field(default_factory=CompareConfig)
    moving_mps: float = Field(0.5, gt=0, description="faster cells are claimed to move")
    slow_mps: float = Field(
        0.2,
        gt=0,
        description="slower cells rest; between this and `moving_mps` the points alone decide",
    )
    similar_mps: float = Field(1.0, gt=0, description="velocity step inside one component")
    similar_share: float = Field(0.35, ge=0, description="the same, as a share of the speed")
    past_sweeps: int = Field(
        2, ge=1, description="past sweeps to register to, evenly over those that are given"
    )
    least_probability: float = Field(
        0.5, ge=0, le=1, description="of moving: a motion that is less likely is withdrawn"
    )


class ClaimedComponents(NamedTuple):
    """Components that a field claims to move."""

    cells: I64
    """(H, W) component of each cell, -1 for none."""
    motions: ComponentMotions


def refine(field: FlowField, pair: SweepPair, config: RefineConfig) -> FlowField:
    """Return the field with each moving component refined or withdrawn."""
    found = refine_components(field, pair, config)
    return field if found is None else _applied(field, found, config)


def refine_components(
    field: FlowField, pair: SweepPair, config: RefineConfig
) -> ClaimedComponents | None:
    """Return the components that a field claims to move, with their motions; None without any."""
    vx, vy = np.moveaxis(field.velocity_mps, -1, 0)
    # in 64 bits, so that a threshold is not rounded to the precision of the field
    speed_mps = np.sqrt(vx * vx + vy * vy).astype(np.float64)
    usable, moves = field.occupied & field.valid, speed_mps > config.moving_mps
    similar = Similar(config.similar_mps, config.similar_share)
    cells, moving = moving_cells(field.velocity_mps, usable & moves, similar)
    # apart: where a mover fades into its surroundings, slow cells would link them
    slow = usable & ~moves & (speed_mps > config.slow_mps)
    slow_cells, count = moving_cells(field.velocity_mps, slow, similar)
    cells, count = np.where(slow, slow_cells + moving, cells), moving + count
    past = chosen_past(pair, config.past_sweeps)
    if count == 0 or not past or len(pair.current) == 0:
        return None
    current = CurrentPoints(pair, config.match)
    rows, cols, inside = field.grid.cells(current.points_m)
    points = np.bincount(cells[rows, cols][inside] + 1, minlength=count + 1)[1:]
    medians = _medians(field.velocity_mps, cells, count)
    owner = owners_of_fragments(cells, medians, points < MIN_POINTS, similar)
    kept, owner = np.unique(owner, return_inverse=True)
    cells, count = np.where(cells >= 0, owner[cells], -1), len(kept)
    labels = Labels(np.where(inside, cells[rows, cols], -1), count)
    claimed_mps = _medians(field.velocity_mps, cells, count)
    claims = Claims(
        claimed_mps,
        _medians(field.covariance_m2ps2, cells, count),
        _spreads(field.velocity_mps, cells, claimed_mps),
    )
    return ClaimedComponents(cells, component_motions(current, past, labels, claims))


def chosen_past(pair: SweepPair, count: int) -> list[PastSweep]:
    """Return up to `count` past sweeps that hold points, the newest first, evenly over the rest."""
    newest_first = [past for past in reversed(pair.past) if len(past.obstacles)]
    if len(newest_first) <= count:
        return newest_first
    index = np.linspace(0, len(newest_first) - 1, count).round().astype(int)
    return [newest_first[i] for i in index]


def _medians(values: Floats, cells: I64, count: int) -> F64:
    """Return (K, ...) the median value of each component, of values (H, W, ...)."""
    chosen = cells >= 0
    owner = cells[chosen]
    order = np.argsort(owner, kind="stable")
    spans = np.searchsorted(owner[order], np.arange(count + 1))
    found = medians_of_spans(values[chosen][order].reshape(len(order), -1), spans)
    return found.reshape(count, *values.shape[2:])


def _spreads(velocity_mps: F32, cells: I64, medians_mps: F64) -> F64:
    """Return (K,) root mean square distances of the cells (H, W, 2) from their medians (K, 2)."""
    chosen = cells >= 0
    owner = cells[chosen]
    squared = ((velocity_mps[chosen] - medians_mps[owner]) ** 2).sum(axis=1)
    spread: F64 = np.sqrt(np.bincount(owner, squared) / np.bincount(owner))
    return spread


def _applied(field: FlowField, found: ClaimedComponents, config: RefineConfig) -> FlowField:
    """Apply the motions.

    A withdrawn v was real with probability p: its covariance gains p v v^T. Slow cells that have
    no motion keep what they had.
    """
    cells, motions = found
    velocity_mps = np.array(field.velocity_mps)
    p = motions.p_moving
    moves = (p >= config.least_probability) & motions.judged
    enough = (motions.points >= MIN_POINTS) & motions.judged
    claimed = np.hypot(velocity_mps[..., 0], velocity_mps[..., 1]) > config.moving_mps
    rows, cols = np.nonzero((cells >= 0) & (claimed | moves[cells]))
    owner = cells[rows, cols]
    place_m = field.grid.centres_m()[rows, cols]
    moved_mps = motions.velocities_mps(owner, place_m)
    doubt = np.where(moves, 0.0, p)[owner][:, None, None] * np.einsum(
        "ca,cb->cab", moved_mps, moved_mps
    )
    covariance = np.array(field.covariance_m2ps2)
    velocity_mps[rows, cols] = np.where(moves[owner][:, None], moved_mps, 0.0)
    covariance[rows, cols] = motions.covariance_m2ps2[owner] + doubt
    valid = field.valid.copy()
    valid[rows, cols] &= (moves | enough)[owner]
    return replace(field, velocity_mps=velocity_mps, covariance_m2ps2=covariance, valid=valid)

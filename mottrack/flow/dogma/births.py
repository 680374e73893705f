"""New-born particles: where occupancy appeared, at rest, slow or fast.

Whatever appears was somewhere before. A velocity that would have brought it out of space known to
be free is drawn again, so that the front of a moving object produces velocities that keep up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I64
from mottrack.flow.dogma.noise import draw, normal_level, uniform, uniform_level
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Span, Workers

MAX_DRAWS = 4
"""Draws of a velocity. Each costs as much as the first; where a share p of the draws comes from
free space, p^4 of the particles still do."""


class BirthConfig(StrictModel):
    """Velocity of new-born particles: at rest, or one of two zero-mean normal distributions."""

    rest_share: float = Field(0.8, ge=0, le=1, description="share at rest of what came into view")
    slow_share: float = Field(0.4, ge=0, le=1, description="share of slow particles in the rest")
    slow_mps: float = Field(1.0, ge=0, description="standard deviation per axis, slow particles")
    fast_mps: float = Field(12.0, ge=0, description="standard deviation per axis, fast particles")
    draws: int = Field(
        MAX_DRAWS,
        ge=1,
        le=MAX_DRAWS,
        description="draws of a velocity while its origin is free space; 1: as Nuss et al.",
    )


class VelocityPrior(NamedTuple):
    """`BirthConfig` and what was known before the last prediction, as the kernel takes them."""

    rest: F32
    """(cells,) share at rest."""
    slow: np.float32
    """Share of slow particles among those that move."""
    slow_mps: np.float32
    fast_mps: np.float32
    free: F32
    """(rows, cols) free mass before the last prediction, on the present window."""
    dt_s: np.float32
    """How long ago that was."""
    draws: int
    """Of each velocity, at most."""

    @classmethod
    def of(cls, config: BirthConfig, uncovered: F32, free: F32, dt_s: float) -> VelocityPrior:
        """Return the prior; only the `uncovered` share (rows, cols) of births may be at rest."""
        return cls(
            np.float32(config.rest_share) * uncovered.ravel(),
            np.float32(config.slow_share),
            np.float32(config.slow_mps),
            np.float32(config.fast_mps),
            free,
            np.float32(dt_s),
            config.draws,
        )


class Births(NamedTuple):
    """New-born particles sorted by cell."""

    start: I64
    """(cells + 1,) particles `start[c]:start[c + 1]` are born in cell c."""
    mass_each: float
    """Share of the born mass that each one carries."""


def allocate_births(born: F32, count: int, key: np.uint64) -> Births:
    """Divide `count` particles among the cells in proportion to the born mass (rows, cols).

    Systematic: a cell gets its exact share rounded up or down, by one random number for all.
    """
    start = np.zeros(born.size + 1, np.int64)
    total = _allocate(born.ravel(), count, uniform(key), start)
    return Births(start, total / count)


@compiled(nogil=True)
def _allocate(born: F32, count: int, offset: float, start: I64) -> float:
    """Fill `start` and return the total mass; sequentially, so that sums never differ."""
    total = 0.0
    for c in range(len(born)):
        total += born[c]
    if total <= 0.0:
        return 0.0
    reached = 0.0
    for c in range(len(born)):
        reached += born[c]
        start[c + 1] = min(int(np.floor(reached / total * count + offset)), count)
    return total


def draw_births(
    births: Births, window: Window, prior: VelocityPrior, key: np.uint64, workers: Workers
) -> Particles:
    """Return particles uniform in their cell, with velocities drawn from the prior."""
    born = Particles.empty(int(births.start[-1]))
    cells = len(births.start) - 1
    workers.run(_draw_cells, cells, births.start, window, _Source(prior, key), born)
    return born


class _Source(NamedTuple):
    prior: VelocityPrior
    key: np.uint64


@compiled(nogil=True)
def _draw_cells(cells: Span, start: I64, window: Window, source: _Source, born: Particles) -> None:
    prior, key = source
    cell_m = np.float32(window.cell_m)
    for cell in range(cells[0], cells[1]):
        rest = prior.rest[cell]
        slow = rest + (np.float32(1) - rest) * prior.slow
        for i in range(start[cell], start[cell + 1]):
            for attempt in range(prior.draws):
                bits = draw(key, np.uint64(i * MAX_DRAWS + attempt))
                pick = uniform_level(bits, 2)
                spread_mps = prior.slow_mps if pick < slow else prior.fast_mps
                spread_mps = np.float32(0) if pick < rest else spread_mps
                born.x_m[i] = (cell % window.cols + uniform_level(bits, 0)) * cell_m
                born.y_m[i] = (cell // window.cols + uniform_level(bits, 1)) * cell_m
                born.vx_mps[i] = spread_mps * normal_level(bits, 3)
                born.vy_mps[i] = spread_mps * normal_level(bits, 4)
                if uniform_level(draw(key, bits), 0) >= _free_before(i, born, window, prior):
                    break


@compiled(nogil=True)
def _free_before(i: int, born: Particles, window: Window, prior: VelocityPrior) -> np.float32:
    """Return the free mass of the cell that particle i came from; 0 at rest or from outside."""
    vx, vy = born.vx_mps[i], born.vy_mps[i]
    if (vx == 0) & (vy == 0):
        return np.float32(0)
    per_m = np.float32(1.0 / window.cell_m)
    col = int(np.floor((born.x_m[i] - vx * prior.dt_s) * per_m))
    row = int(np.floor((born.y_m[i] - vy * prior.dt_s) * per_m))
    if 0 <= row < window.rows and 0 <= col < window.cols:
        free: np.float32 = prior.free[row, col]
        return free
    return np.float32(0)

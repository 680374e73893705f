"""Occupancy of the cells: prediction, evidential update, and the split into persistent and born."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.dogma.measurement_grid import MeasurementGrid
from mottrack.flow.dogma.predict import REFERENCE_PERIOD_S

Grid = NDArray[np.float32]
"""(rows, cols) one number a cell."""


_TINY = np.float32(1e-9)


class OccupancyConfig(StrictModel):
    """How evidence ages and how occupancy comes into being."""

    remember: float = Field(0.9, gt=0, le=1, description="share of free mass kept over 0.1 s")
    birth: float = Field(
        0.01, gt=0, le=1, description="p_B: probability that an object appears in a known cell"
    )
    birth_unseen: float = Field(
        0.05, gt=0, le=1, description="... that one is found where nothing was known before"
    )


class Masses(NamedTuple):
    """Dempster-Shafer masses of the hypotheses occupied and free; the rest is unknown."""

    occupied: Grid
    free: Grid


class Prior(NamedTuple):
    """Predicted masses; what is neither occupied nor free is unknown."""

    occupied: Grid
    free: Grid
    unseen: Grid
    """The part of the unknown mass that was unknown before; from the rest something has left."""


class Split(NamedTuple):
    """Occupied mass by where it came from."""

    persistent: Grid
    """Carried by particles that were there before."""
    born: Grid
    """Newly appeared."""
    uncovered: Grid
    """Share of the born mass that came into view; the rest moved into the cell."""


def kept_over(dt_s: float, config: OccupancyConfig) -> float:
    """Share alpha(dt) of what was known that is kept over `dt_s`."""
    return float(config.remember ** (dt_s / REFERENCE_PERIOD_S))


def predict_masses(carried: Grid, before: Masses, kept: float) -> Prior:
    """Occupied mass is what the particles carry (rows, cols), at most one; free mass fades.

    The paper's m_occ- = min(sum w, 1) and m_free- = min(alpha m_free, 1 - m_occ-).
    """
    occupied = np.minimum(carried, np.float32(1))
    free = np.minimum(before.free * np.float32(kept), 1 - occupied)
    unseen = np.minimum(1 - before.occupied - before.free, 1 - occupied - free)
    return Prior(occupied, free, np.maximum(unseen, 0))


def update_masses(prior: Prior, measured: MeasurementGrid) -> Masses:
    """Dempster's rule of combination on the frame {occupied, free}.

    With K the mass on which the two contradict each other, m_occ = (m_occ- (1 - z_free)
    + (1 - m_occ- - m_free-) z_occ) / (1 - K), and the same for free.
    """
    conflict = prior.free * measured.occupied + prior.occupied * measured.free
    unknown = 1 - prior.occupied - prior.free
    agreed = 1 - conflict
    occupied = (prior.occupied * (1 - measured.free) + unknown * measured.occupied) / agreed
    free = (prior.free * (1 - measured.occupied) + unknown * measured.free) / agreed
    occupied = np.clip(occupied, 0, 1)
    return Masses(occupied, np.clip(free, 0, 1 - occupied))


def split_masses(prior: Prior, posterior: Masses, config: OccupancyConfig) -> Split:
    """Born mass rho_b = m_occ a / (m_occ- + a), where a is the mass that may have appeared.

    The paper takes a = p_B (1 - m_occ-). Here unseen mass has a probability of its own: what
    appears where something else was known must have moved there, but what comes into view is no
    evidence of motion, or the rim of the view would seem to move with the vehicle.
    """
    arrived = np.float32(config.birth) * (1 - prior.occupied - prior.unseen)
    uncovered = np.float32(config.birth_unseen) * prior.unseen
    appearing = np.maximum(arrived + uncovered, _TINY)
    born = posterior.occupied * (appearing / (prior.occupied + appearing))
    return Split(posterior.occupied - born, born, uncovered / appearing)

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
        0.02, gt=0, le=1, description="p_B: probability that an object appears where it was free"
    )
    birth_unknown: float = Field(
        1.0, gt=0, le=1, description="... where nothing was known; the paper has p_B here too"
    )


class Masses(NamedTuple):
    """Dempster-Shafer masses of the hypotheses occupied and free; the rest is unknown."""

    occupied: Grid
    free: Grid


class Split(NamedTuple):
    """Occupied mass by where it came from."""

    persistent: Grid
    """Carried by particles that were there before."""
    born: Grid
    """Newly appeared."""


def predict_masses(count: Grid, mass_each: float, free: Grid, kept: float) -> Masses:
    """Occupied mass from the (rows, cols) `count` of particles; free mass fades by `kept`.

    The sum of the particles' weights is m_occ-, at most one; m_free- is
    min(alpha m_free, 1 - m_occ-).
    """
    occupied = np.minimum(count * np.float32(mass_each), np.float32(1))
    return Masses(occupied, np.minimum(free * np.float32(kept), 1 - occupied))


def kept_over(dt_s: float, config: OccupancyConfig) -> float:
    """Share alpha(dt) of the free mass that is kept over `dt_s`."""
    return float(config.remember ** (dt_s / REFERENCE_PERIOD_S))


def update_masses(prior: Masses, measured: MeasurementGrid) -> Masses:
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


def split_masses(prior: Masses, posterior: Masses, config: OccupancyConfig) -> Split:
    """Born mass rho_b = m_occ a / (m_occ- + a), where a is the mass that may have appeared.

    The paper takes a = p_B (1 - m_occ-). Here the free and the unknown mass have a p_B each: what
    appears where it was free must have moved there, but what appears where nothing was known is no
    evidence of motion, or the rim of the view would seem to move with the vehicle.
    """
    unknown = 1 - prior.occupied - prior.free
    appearing = np.float32(config.birth) * prior.free + np.float32(config.birth_unknown) * unknown
    born = posterior.occupied * appearing / np.maximum(prior.occupied + appearing, _TINY)
    return Split(posterior.occupied - born, born)

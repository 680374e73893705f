"""Occupancy of the cells: prediction, evidential update, and the split into persistent and born."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I32
from mottrack.flow.dogma.measurement_grid import MeasurementGrid
from mottrack.flow.dogma.predict import REFERENCE_PERIOD_S
from mottrack.flow.dogma.workers import Span, Workers


class OccupancyConfig(StrictModel):
    """How evidence ages and how occupancy comes into being."""

    remember: float = Field(0.9, gt=0, le=1, description="share of free mass kept over 0.1 s")
    birth: float = Field(
        0.01, gt=0, le=1, description="p_B: probability that an object appears in a known cell"
    )
    birth_unseen: float = Field(
        0.05, gt=0, le=1, description="... that one is found where nothing was known before"
    )


class Rates(NamedTuple):
    """`OccupancyConfig` over one prediction, as the kernel takes it."""

    kept: float
    """Share alpha(dt) of the free mass."""
    birth: float
    birth_unseen: float

    @classmethod
    def over(cls, dt_s: float, config: OccupancyConfig) -> Rates:
        """What is kept fades exponentially."""
        kept = float(config.remember ** (dt_s / REFERENCE_PERIOD_S))
        return cls(kept, config.birth, config.birth_unseen)


class Carried(NamedTuple):
    """Occupied mass that the particles bring along."""

    start: I32
    """(cells + 1,) cell c holds `start[c + 1] - start[c]` particles."""
    weight: float
    """Mass of each after survival."""


class Masses(NamedTuple):
    """Dempster-Shafer masses of the hypotheses occupied and free; the rest is unknown."""

    occupied: F32
    free: F32

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> Masses:
        """Nothing is known of any cell."""
        return cls(np.zeros(shape, np.float32), np.zeros(shape, np.float32))


class Split(NamedTuple):
    """Occupied mass by where it came from."""

    persistent: F32
    """Carried by particles that were there before."""
    born: F32
    """Newly appeared."""
    uncovered: F32
    """Share of the born mass that came into view; the rest moved into the cell."""

    @classmethod
    def nothing(cls, shape: tuple[int, int]) -> Split:
        """No mass anywhere."""
        return cls(*(np.zeros(shape, np.float32) for _ in range(3)))


def update_occupancy(
    carried: Carried, before: Masses, measured: MeasurementGrid, rates: Rates, workers: Workers
) -> tuple[Masses, Split]:
    """Predicts every cell, combines it with the measurement and splits what is occupied."""
    shape = measured.occupied.shape
    after, split = Masses.unknown(shape), Split.nothing(shape)
    workers.run(_update, shape[0], (carried, rates), before, measured, (after, split))
    return after, split


@compiled(nogil=True)
def _update(
    rows: Span,
    prediction: tuple[Carried, Rates],
    before: Masses,
    measured: MeasurementGrid,
    result: tuple[Masses, Split],
) -> None:
    carried, rates = prediction
    after, split = result
    cols = before.free.shape[1]
    for row in range(rows[0], rows[1]):
        for col in range(cols):
            cell = row * cols + col
            mass = (carried.start[cell + 1] - carried.start[cell]) * carried.weight
            known = (before.occupied[row, col], before.free[row, col])
            evidence = (measured.occupied[row, col], measured.free[row, col])
            prior = predict_cell(mass, known, rates)
            occupied, free = combine(prior, evidence)
            persistent, born, uncovered = split_cell(prior, occupied, rates)
            after.occupied[row, col], after.free[row, col] = occupied, free
            split.persistent[row, col], split.born[row, col] = persistent, born
            split.uncovered[row, col] = uncovered


@compiled(nogil=True)
def predict_cell(
    carried: float, before: tuple[float, float], rates: Rates
) -> tuple[float, float, float]:
    """Predicted masses: occupied, free, and unseen.

    The paper's m_occ- = min(sum w, 1) and m_free- = min(alpha m_free, 1 - m_occ-). Unseen is the
    part of the unknown mass that was unknown before, too; from the rest something has left.
    """
    occupied = min(carried, 1.0)
    free = min(rates.kept * before[1], 1.0 - occupied)
    unseen = min(1.0 - before[0] - before[1], 1.0 - occupied - free)
    return occupied, free, max(unseen, 0.0)


@compiled(nogil=True)
def combine(
    prior: tuple[float, float, float], evidence: tuple[float, float]
) -> tuple[float, float]:
    """Dempster's rule of combination on the frame {occupied, free}: occupied and free.

    With K the mass on which the two contradict each other, m_occ = (m_occ- (1 - z_free)
    + (1 - m_occ- - m_free-) z_occ) / (1 - K), and the same for free.
    """
    occupied, free, _ = prior
    z_occupied, z_free = evidence
    unknown = 1.0 - occupied - free
    agreed = 1.0 - free * z_occupied - occupied * z_free
    after = min(max((occupied * (1.0 - z_free) + unknown * z_occupied) / agreed, 0.0), 1.0)
    cleared = (free * (1.0 - z_occupied) + unknown * z_free) / agreed
    return after, min(max(cleared, 0.0), 1.0 - after)


@compiled(nogil=True)
def split_cell(
    prior: tuple[float, float, float], occupied: float, rates: Rates
) -> tuple[float, float, float]:
    """Persistent mass, born mass rho_b = m_occ a / (m_occ- + a), and what of `a` was uncovered.

    The paper takes a = p_B (1 - m_occ-). Here unseen mass has a probability of its own: what
    appears where something else was known must have moved there, but what comes into view is no
    evidence of motion, or the rim of the view would seem to move with the vehicle.
    """
    before, _, unseen = prior
    uncovered = rates.birth_unseen * unseen
    appearing = rates.birth * (1.0 - before - unseen) + uncovered
    if appearing <= 0.0:
        return occupied, 0.0, 0.0
    born = occupied * appearing / (before + appearing)
    return occupied - born, born, uncovered / appearing

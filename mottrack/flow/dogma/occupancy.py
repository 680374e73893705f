"""Occupancy of the cells: prediction, evidential update, and the split into persistent and born."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I32
from mottrack.flow.dogma.measurement_grid import Masses
from mottrack.flow.dogma.predict import REFERENCE_PERIOD_S
from mottrack.flow.dogma.workers import Span, Workers


class OccupancyConfig(StrictModel):
    """How evidence ages and how occupancy appears."""

    free_kept: float = Field(0.9, gt=0, le=1, description="share of free mass kept over 0.1 s")
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
        """Return the rates over `dt_s`; the kept share decays exponentially."""
        kept = config.free_kept ** (dt_s / REFERENCE_PERIOD_S)
        return cls(kept, config.birth, config.birth_unseen)


class Prior(NamedTuple):
    """What is known before the measurement."""

    start: I32
    """(cells + 1,) cell c holds `start[c + 1] - start[c]` particles."""
    weight: float
    """Occupied mass that each particle carries, after survival."""
    masses: Masses
    """Posterior masses of the cycle before, on the present window."""
    rates: Rates


class Split(NamedTuple):
    """Occupied mass by origin."""

    persistent: F32
    """(rows, cols) carried by particles that were there before."""
    born: F32
    """(rows, cols) newly appeared."""
    uncovered: F32
    """(rows, cols) share of the born mass that came into view; the rest moved into the cell."""


class Posterior(NamedTuple):
    """What is known after the measurement."""

    masses: Masses
    split: Split


class CellPrior(NamedTuple):
    """Predicted masses of one cell."""

    occupied: float
    free: float
    unseen: float
    """The part of the unknown mass that was unknown before, too."""


class CellSplit(NamedTuple):
    """`Split` of one cell."""

    persistent: float
    born: float
    uncovered: float


def update_occupancy(prior: Prior, measured: Masses, workers: Workers) -> Posterior:
    """Predict every cell, combine it with the measurement and split the occupied mass."""
    shape = measured.occupied.shape
    split = Split(*(np.zeros(shape, np.float32) for _ in range(3)))
    posterior = Posterior(Masses.unknown(shape), split)
    workers.run(_update, shape[0], prior, measured, posterior)
    return posterior


@compiled(nogil=True)
def _update(rows: Span, prior: Prior, measured: Masses, posterior: Posterior) -> None:
    start, weight, before, rates = prior
    after, split = posterior
    cols = before.free.shape[1]
    for row in range(rows[0], rows[1]):
        for col in range(cols):
            cell = row * cols + col
            carried = (start[cell + 1] - start[cell]) * weight
            known = (before.occupied[row, col], before.free[row, col])
            evidence = (measured.occupied[row, col], measured.free[row, col])
            predicted = predict_cell(carried, known, rates)
            occupied, free = combine(predicted, evidence)
            persistent, born, uncovered = split_cell(predicted, occupied, rates)
            after.occupied[row, col], after.free[row, col] = occupied, free
            split.persistent[row, col], split.born[row, col] = persistent, born
            split.uncovered[row, col] = uncovered


@compiled(nogil=True)
def predict_cell(carried: float, before: tuple[float, float], rates: Rates) -> CellPrior:
    """Predict a cell from the mass its particles carry and its occupied and free mass before.

    The paper's m_occ- = min(sum w, 1) and m_free- = min(alpha m_free, 1 - m_occ-). From mass that
    is unknown now but was known before something has left: it is not unseen.
    """
    occupied = min(carried, 1.0)
    free = min(rates.kept * before[1], 1.0 - occupied)
    unseen = min(1.0 - before[0] - before[1], 1.0 - occupied - free)
    return CellPrior(occupied, free, max(unseen, 0.0))


@compiled(nogil=True)
def combine(prior: CellPrior, evidence: tuple[float, float]) -> tuple[float, float]:
    """Return occupied and free mass by Dempster's rule on the frame {occupied, free}.

    With K the mass on which the two contradict each other, m_occ = (m_occ- (1 - z_free)
    + (1 - m_occ- - m_free-) z_occ) / (1 - K), and the same for free.
    """
    occupied, free = prior.occupied, prior.free
    z_occupied, z_free = evidence
    unknown = 1.0 - occupied - free
    agreed = 1.0 - free * z_occupied - occupied * z_free
    after = min(max((occupied * (1.0 - z_free) + unknown * z_occupied) / agreed, 0.0), 1.0)
    cleared = (free * (1.0 - z_occupied) + unknown * z_free) / agreed
    return after, min(max(cleared, 0.0), 1.0 - after)


@compiled(nogil=True)
def split_cell(prior: CellPrior, occupied: float, rates: Rates) -> CellSplit:
    """Split the occupied mass: born rho_b = m_occ a / (m_occ- + a), the rest is persistent.

    The paper takes a = p_B (1 - m_occ-). Here unseen mass has a probability of its own: what
    appears in a cell of which something was known must have moved there, but what comes into view
    is no evidence of motion, or the edge of the view would seem to move with the vehicle.
    """
    uncovered = rates.birth_unseen * prior.unseen
    appearing = rates.birth * (1.0 - prior.occupied - prior.unseen) + uncovered
    if appearing <= 0.0:
        return CellSplit(occupied, 0.0, 0.0)
    born = occupied * appearing / (prior.occupied + appearing)
    return CellSplit(occupied - born, born, uncovered / appearing)

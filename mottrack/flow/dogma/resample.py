"""Systematic resampling of persistent and new-born particles together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mottrack.flow.dogma.assign import Assignment
from mottrack.flow.dogma.births import Births
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.workers import Span, Workers

_ROUNDING = 1e-6
"""Keeps the first and the last tooth clear of the ends, where rounding could gain or lose one."""


class Candidates(NamedTuple):
    """The particles to draw from, those of a cell next to each other."""

    particles: Particles
    assignment: Assignment
    born: Particles
    births: Births


def resample(
    candidates: Candidates,
    persistent: NDArray[np.float32],
    offset: float,
    chosen: Particles,
    workers: Workers,
) -> float:
    """Fills `chosen` with particles drawn in proportion to mass; returns the mass of each.

    The mass of all cells is laid out in a row, the persistent (rows, cols) mass of a cell before
    its born mass, and comb teeth of equal spacing, the first at `offset` in [0, 1) of it, pick the
    particles. Without any mass `chosen` is left as it is and weighs nothing.
    """
    begin = _layout(persistent.ravel(), candidates.births)
    spacing = float(begin[-1]) / len(chosen.x_m)
    if spacing > 0:
        comb = (spacing, min(max(offset, _ROUNDING), 1 - _ROUNDING))
        workers.run(_comb, persistent.size, candidates, begin, comb, chosen)
    return spacing


@njit(cache=True, nogil=True)
def _layout(persistent: NDArray[np.float32], births: Births) -> NDArray[np.float64]:
    """(2 cells + 1,) where the persistent and the born mass of each cell begin, in turn."""
    cells = len(persistent)
    begin = np.empty(2 * cells + 1)
    begin[0] = 0.0
    for c in range(cells):
        born = (births.start[c + 1] - births.start[c]) * births.mass_each
        begin[2 * c + 1] = begin[2 * c] + persistent[c]
        begin[2 * c + 2] = begin[2 * c + 1] + born
    return begin


@njit(cache=True, nogil=True)
def _comb(
    cells: Span,
    candidates: Candidates,
    begin: NDArray[np.float64],
    comb: tuple[float, float],
    chosen: Particles,
) -> None:
    spacing, offset = comb
    order, persistent_start = candidates.assignment.order, candidates.assignment.start
    born_start = candidates.births.start
    for cell in range(cells[0], cells[1]):
        for kind in range(2):
            group = 2 * cell + kind
            tooth = int(np.ceil(begin[group] / spacing - offset))
            end = int(np.ceil(begin[group + 1] / spacing - offset))
            if tooth == end:
                continue
            first = born_start[cell] if kind else persistent_start[cell]
            count = (born_start[cell + 1] if kind else persistent_start[cell + 1]) - first
            per_mass = count / (begin[group + 1] - begin[group])
            for k in range(tooth, end):
                member = int(((k + offset) * spacing - begin[group]) * per_mass)
                index = first + min(max(member, 0), count - 1)
                if kind:
                    _copy(candidates.born, index, chosen, k)
                else:
                    _copy(candidates.particles, order[index], chosen, k)


@njit(cache=True, nogil=True)
def _copy(source: Particles, index: int, target: Particles, place: int) -> None:
    target.x_m[place] = source.x_m[index]
    target.y_m[place] = source.y_m[index]
    target.vx_mps[place] = source.vx_mps[index]
    target.vy_mps[place] = source.vy_mps[index]

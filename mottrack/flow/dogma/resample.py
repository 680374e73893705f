"""Systematic resampling of persistent and new-born particles together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, F64
from mottrack.flow.dogma.births import Births
from mottrack.flow.dogma.particles import Assignment, Particles
from mottrack.flow.dogma.workers import Span, Workers

_ROUNDING = 1e-6
"""Distance of the first and the last tooth from the ends, where rounding could add or lose one."""


class Candidates(NamedTuple):
    """The particles to draw from, those of a cell next to each other."""

    particles: Particles
    assignment: Assignment
    born: Particles
    births: Births


class _Comb(NamedTuple):
    """The mass of all cells in a row, and the teeth of equal spacing along it."""

    begin: F64
    """(cells + 1,) where the mass of each cell begins: persistent, then born."""
    persistent: F32
    """(cells,)."""
    spacing: float
    offset: float
    """Place of the first tooth, in spacings."""


def resample(
    candidates: Candidates, persistent: F32, offset: float, chosen: Particles, workers: Workers
) -> float:
    """Fill `chosen` with particles drawn in proportion to mass; return the mass of each.

    The mass of all cells is laid out in a row, the persistent (rows, cols) mass of a cell before
    its born mass, and comb teeth of equal spacing, the first at `offset` in [0, 1) of it, pick the
    particles. Without any mass `chosen` is unchanged and 0 is returned.
    """
    begin = _cumulative(persistent.ravel(), candidates.births)
    spacing = float(begin[-1]) / len(chosen.x_m)
    if spacing > 0:
        offset = min(max(offset, _ROUNDING), 1 - _ROUNDING)
        comb = _Comb(begin, persistent.ravel(), spacing, offset)
        workers.run(_draw, persistent.size, candidates, comb, chosen)
    return spacing


@compiled(nogil=True)
def _cumulative(persistent: F32, births: Births) -> F64:
    begin = np.empty(len(persistent) + 1)
    begin[0] = 0.0
    for c in range(len(persistent)):
        born = (births.start[c + 1] - births.start[c]) * births.mass_each
        begin[c + 1] = begin[c] + persistent[c] + born
    return begin


@compiled(nogil=True)
def _draw(cells: Span, candidates: Candidates, comb: _Comb, chosen: Particles) -> None:
    begin, persistent, spacing, offset = comb
    start, born_start = candidates.assignment.start, candidates.births.start
    for c in range(cells[0], cells[1]):
        if begin[c] == begin[c + 1]:
            continue
        middle = begin[c] + persistent[c]
        for born in range(2):
            low, high = (middle, begin[c + 1]) if born else (begin[c], middle)
            # the first teeth at or beyond both ends
            tooth = int(np.ceil(low / spacing - offset))
            end = int(np.ceil(high / spacing - offset))
            first = born_start[c] if born else start[c]
            count = (born_start[c + 1] if born else start[c + 1]) - first
            for k in range(tooth, end):
                share = ((k + offset) * spacing - low) / (high - low)
                index = first + min(max(int(share * count), 0), count - 1)
                if born:
                    _copy(candidates.born, index, chosen, k)
                else:
                    _copy(candidates.particles, candidates.assignment.order[index], chosen, k)


@compiled(nogil=True)
def _copy(source: Particles, index: int, target: Particles, place: int) -> None:
    target.x_m[place] = source.x_m[index]
    target.y_m[place] = source.y_m[index]
    target.vx_mps[place] = source.vx_mps[index]
    target.vy_mps[place] = source.vy_mps[index]

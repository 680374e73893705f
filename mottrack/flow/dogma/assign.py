"""Assignment of particles to grid cells by a counting sort."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import I32
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Span, Workers


class Assignment(NamedTuple):
    """Which particles lie in which cell; cell = row * cols + col."""

    order: I32
    """(N,) particle indices sorted by cell, ascending within a cell; those outside come last."""
    start: I32
    """(cells + 1,) `order[start[c]:start[c + 1]]` are the particles of cell c."""


def assign(particles: Particles, window: Window, before: Window, workers: Workers) -> Assignment:
    """Sorts the particles by cell; a stable sort, so the order does not depend on threads.

    Only cells that were in the window `before` can hold particles. What lay beyond its edge was
    not known, and what is seen there now would all seem to have crossed the edge with the vehicle.
    """
    count = len(particles.x_m)
    cell = np.empty(count, np.int32)
    workers.run(_cells, count, particles, window, window.kept_from(before), cell)
    order = np.empty(count, np.int32)
    start = _sort(cell, window.rows * window.cols, order)
    return Assignment(order, start)


@compiled(nogil=True)
def _cells(
    span: Span,
    particles: Particles,
    window: Window,
    kept: tuple[int, int, int, int],
    cell: I32,
) -> None:
    outside = window.rows * window.cols
    per_m = np.float32(1.0 / window.cell_m)
    for i in range(span[0], span[1]):
        col = int(np.floor(particles.x_m[i] * per_m))
        row = int(np.floor(particles.y_m[i] * per_m))
        inside = (row >= kept[0]) & (row < kept[1]) & (col >= kept[2]) & (col < kept[3])
        cell[i] = row * window.cols + col if inside else outside


@compiled(nogil=True)
def _sort(cell: I32, cells: int, order: I32) -> I32:
    """Start of every cell; fills `order`. Particles outside have the cell number `cells`."""
    fill = np.zeros(cells + 2, np.int32)
    for i in range(len(cell)):
        fill[cell[i] + 1] += 1
    for c in range(cells + 1):
        fill[c + 1] += fill[c]
    start = fill[: cells + 1].copy()
    for i in range(len(cell)):
        order[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return start

"""A flat world to look at: straight edges, a scanner in the plane, and the filter's windows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mottrack.flow.dogma.filter import DynamicGridFilter, FilterConfig, GridMap
from mottrack.flow.dogma.measurement_grid import GROUND, OBSTACLE, Returns, SensorConfig, measure
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers

Edges = NDArray[np.float64]
"""(M, 4) x and y of both ends of every edge, world metres."""


def box_edges(centre: tuple[float, float], length: float, width: float) -> Edges:
    x, y = centre
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, width / 2] + [x, y]
    return np.column_stack([corners, np.roll(corners, -1, axis=0)])


def scan(centre: NDArray[np.float64], edges: Edges, rng: np.random.Generator) -> Returns:
    """1800 beams to the nearest edge, 2 cm range noise; ground at 45 m where nothing is hit."""
    azimuth = -np.pi + (np.arange(1800) + 0.5) * 2 * np.pi / 1800
    beam = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    start, along = edges[:, :2] - centre, edges[:, 2:] - edges[:, :2]
    cross = beam[:, None, 0] * along[:, 1] - beam[:, None, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        place = (start[:, 0] * beam[:, None, 1] - start[:, 1] * beam[:, None, 0]) / cross
    nearest = np.where((place >= 0) & (place <= 1) & (reach > 0), reach, np.inf).min(axis=1)
    hit = nearest < 45.0
    ranges = np.where(hit, nearest + rng.normal(0, 0.02, len(hit)), 45.0)
    kind = np.where(hit, OBSTACLE, GROUND)
    return Returns((beam * ranges[:, None]).astype(np.float32), kind, centre)


class FlatWorld:
    """Runs the filter over scans of edges that move, on a small window around the vehicle."""

    def __init__(self, config: FilterConfig | None = None, threads: int = 1) -> None:
        self.workers = Workers(threads)
        self.config = config or FilterConfig(particles=60_000, births=6_000)
        self.filter = DynamicGridFilter(self.config, self.workers)
        self.rng = np.random.default_rng(5)

    def cycle(self, ego_x_m: float, edges: Edges) -> tuple[GridMap, NDArray[np.int64]]:
        """The map after a scan, and (N, 2) row and column of the returns in it."""
        centre = np.array([ego_x_m, 0.0])
        window = Window.around(ego_x_m, 0.0, 200, 0.25)
        returns = scan(centre, edges, self.rng)
        measured = measure(returns, window, SensorConfig(), self.workers)
        grid_map = self.filter.step(measured, window, 0.1)
        hits = returns.xy_m[returns.kind == OBSTACLE] + centre - window.corner_m
        cells = np.floor(hits[:, ::-1] / window.cell_m).astype(np.int64)
        inside = ((cells >= 0) & (cells < 200)).all(axis=1)
        return grid_map, np.unique(cells[inside], axis=0)


@pytest.fixture(scope="session")
def flat_world() -> type[FlatWorld]:
    return FlatWorld


@pytest.fixture(scope="session")
def box() -> Callable[..., Edges]:
    return box_edges

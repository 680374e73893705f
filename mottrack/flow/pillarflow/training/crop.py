"""A turned square cut out of an example: what one row of a batch holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, I64, Mask
from mottrack.flow.pillarflow.descriptors import CellGrid, describe
from mottrack.flow.pillarflow.training.example import EXAMPLE_GRID, Example
from mottrack.flow.pillarflow.training.targets import cell_means


class CropConfig(StrictModel):
    """Which part of an example is shown."""

    size_m: float = Field(32.0, gt=0, description="edge of the square [m]")
    on_movers: float = Field(0.6, ge=0, le=1, description="share of crops around a moving point")
    jitter_m: float = Field(8.0, ge=0, description="the square is off its point by up to this")
    moving_mps: float = Field(0.5, gt=0, description="a point this fast is moving")
    least_previous: int = Field(5, ge=0, description="objects with fewer points then are masked")
    least_current: int = Field(3, ge=0, description="objects with fewer points now are masked")


@dataclass(frozen=True)
class Crop:
    """One row of a batch on `rows x columns` pillars."""

    current: tuple[F32, I64]
    """Descriptors (M,9) and cells (M,)."""
    previous: tuple[F32, I64]
    """The same of the previous sweep."""
    seen: F32
    """(4,rows,columns) unseen and seen-free shares."""
    motion_m: F32
    """(2,rows,columns) target."""
    mask: F32
    """(1,rows,columns) 1 where the target counts."""
    elapsed_s: float
    """Time between the sweeps."""


def crop_centre(example: Example, config: CropConfig, rng: Generator) -> F32:
    """A point (x, y) near a mover or near anything."""
    rows = np.arange(len(example.current))
    if rng.random() < config.on_movers:
        rows = _mover(example, config, rng, rows)
    jitter = rng.uniform(-config.jitter_m, config.jitter_m, 2)
    if not len(rows):
        return jitter.astype(np.float32)
    return (example.current[rng.choice(rows), :2] + jitter).astype(np.float32)


def _mover(example: Example, config: CropConfig, rng: Generator, otherwise: I64) -> I64:
    """Points of one moving object; each is as likely as any other, however few points it has."""
    moving = np.linalg.norm(example.motion_m, axis=1) > config.moving_mps * example.elapsed_s
    if not moving.any():
        return otherwise
    chosen = rng.choice(np.unique(example.current_object[moving]))
    return np.flatnonzero(moving & (example.current_object == chosen))


def turn(rng: Generator) -> F32:
    """A random rotation of the plane, mirrored every second time."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    mirror = rng.choice((-1.0, 1.0))
    return np.array([[c, -s * mirror], [s, c * mirror]], np.float32)


def whole(example: Example, cells: CellGrid, config: CropConfig) -> Crop:
    """The example on a given grid, not turned."""
    return cut(example, cells, np.eye(2, dtype=np.float32), config)


def cut(example: Example, cells: CellGrid, turned: F32, config: CropConfig) -> Crop:
    """The part of an example, turned about the vehicle by `turned` (2,2), that lies on `cells`."""
    current, previous = example.current.copy(), example.previous.copy()
    current[:, :2] = current[:, :2] @ turned.T
    previous[:, :2] = previous[:, :2] @ turned.T
    described = describe(current, cells)
    shape = (cells.rows, cells.columns)
    inside, cells_now = described[2], described[1]
    before = describe(previous, cells)
    counts = observable(example, before[2], inside, config)
    values = np.column_stack(
        ((example.motion_m @ turned.T)[inside], counts[example.current_object[inside]])
    ).astype(np.float32)
    means, points = cell_means(values, cells_now, cells.cells)
    counted = (points > 0) & (means[:, 2] > 0.5)
    return Crop(
        current=described[:2],
        previous=before[:2],
        seen=_seen(example, cells, turned),
        motion_m=means[:, :2].T.reshape(2, *shape),
        mask=counted.reshape(1, *shape).astype(np.float32),
        elapsed_s=example.elapsed_s,
    )


def observable(example: Example, then: Mask, now: Mask, config: CropConfig) -> F32:
    """(K+1,) 1 for objects with enough points on both sides; the last row is the background."""
    count = len(example.centre_m) + 1
    seen_then = np.bincount(example.previous_object[then] + 1, minlength=count)[1:]
    seen_now = np.bincount(example.current_object[now] + 1, minlength=count)[1:]
    enough = (seen_then >= config.least_previous) & (seen_now >= config.least_current)
    return np.append(enough, True).astype(np.float32)


def _seen(example: Example, cells: CellGrid, turned: F32) -> F32:
    """The visibility rasters sampled at the turned cells; outside of them all is unseen."""
    x = cells.x_min_m + (np.arange(cells.columns) + 0.5) * cells.cell_m
    y = cells.y_min_m + (np.arange(cells.rows) + 0.5) * cells.cell_m
    places = np.stack(np.broadcast_arrays(x[None], y[:, None]), axis=-1).reshape(-1, 2) @ turned
    rows, columns, inside = EXAMPLE_GRID.cells(places)
    seen = example.seen[:, rows, columns].astype(np.float32) / 100
    seen[:, ~inside] = np.array([1, 0, 1, 0], np.float32)[:, None]
    return seen.reshape(4, cells.rows, cells.columns).astype(np.float32)

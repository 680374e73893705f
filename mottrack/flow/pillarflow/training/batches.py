"""Crops of examples and batches of them, as a pure function of (seed, step).

A crop is a rotated square cut out of an example: one row of a batch. Resuming needs no state of the
stream, since a batch depends on the seed and the step alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.random import Generator

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, I64, Mask
from mottrack.flow.pillarflow.network import NetworkInput, PointBatch
from mottrack.flow.pillarflow.pillars import DESCRIPTORS, CellGrid, DescribedPoints, describe
from mottrack.flow.pillarflow.sight import SHARES, sight_shares
from mottrack.flow.pillarflow.training.augmentation import augment
from mottrack.flow.pillarflow.training.config import AugmentationConfig, CropConfig
from mottrack.flow.pillarflow.training.examples import EXAMPLE_GRID, Example
from mottrack.flow.pillarflow.training.losses import Target

NO_ROTATION: F32 = np.eye(2, dtype=np.float32)


@dataclass(frozen=True)
class Crop:
    """One row of a batch on `rows x columns` pillars."""

    current: DescribedPoints
    previous: DescribedPoints
    shares: F32
    """(8,rows,columns) as in `NetworkInput`."""
    motion_m: F32
    """(2,rows,columns) target: mean displacement of the points of each cell (III-C)."""
    mask: F32
    """(1,rows,columns) 1 where the target counts."""
    elapsed_s: float
    """Time between the sweeps."""
    older: tuple[DescribedPoints, ...]
    """Of each older sweep; without points where there is none."""
    ratio: F32
    """(S,) time between the sweeps / age of each older one; 0 where there is none."""


def crop_centre(example: Example, config: CropConfig, rng: Generator) -> F32:
    """Draw a point (x, y) near a moving object, or near any point."""
    rows = np.arange(len(example.current))
    if rng.random() < config.moving_share:
        rows = _moving_rows(example, config, rng, rows)
    jitter = rng.uniform(-config.jitter_m, config.jitter_m, 2)
    if not len(rows):
        return jitter.astype(np.float32)
    return (example.current[rng.choice(rows), :2] + jitter).astype(np.float32)


def _moving_rows(example: Example, config: CropConfig, rng: Generator, otherwise: I64) -> I64:
    """Draw one moving object, all equally likely however few points they have; its points."""
    moving = np.linalg.norm(example.motion_m, axis=1) > config.moving_mps * example.elapsed_s
    if not moving.any():
        return otherwise
    chosen = rng.choice(np.unique(example.current_object[moving]))
    return np.flatnonzero(moving & (example.current_object == chosen))


def random_rotation(rng: Generator) -> F32:
    """Draw a rotation of the plane (2,2), mirrored every second time."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    mirror = rng.choice((-1.0, 1.0))
    return np.array([[c, -s * mirror], [s, c * mirror]], np.float32)


def cut(example: Example, cells: CellGrid, rotation: F32, config: CropConfig) -> Crop:
    """Return the part of an example, rotated about the vehicle by (2,2), that lies on `cells`."""
    previous = _described(example.previous, cells, rotation)
    current = _described(example.current, cells, rotation)
    slots = range(len(example.older_age_s))
    older = [example.older[example.older_slot == slot] for slot in slots]
    counts = observable(example, previous.inside, current.inside, config)
    motion_m = (example.motion_m @ rotation.T)[current.inside]
    known = counts[example.current_object[current.inside]]
    values = np.column_stack((motion_m, known)).astype(np.float32)
    means, occupied = _cell_means(values, current.cells, cells.cells)
    counted = occupied & (means[:, 2] > 0.5)  # most of a cell's points are of observable objects
    shape = (cells.rows, cells.columns)
    sight = [
        sight_shares(states[on.inside], on.cells, cells.cells).reshape(SHARES, *shape)
        for states, on in ((example.current_sight, current), (example.previous_sight, previous))
    ]
    return Crop(
        current=current,
        previous=previous,
        shares=np.concatenate((_seen(example, cells, rotation), *sight)),
        motion_m=means[:, :2].T.reshape(2, *shape),
        mask=counted.reshape(1, *shape).astype(np.float32),
        elapsed_s=example.elapsed_s,
        older=tuple(_described(points, cells, rotation) for points in older),
        ratio=(example.elapsed_s / example.older_age_s).astype(np.float32),
    )


def _described(points: F32, cells: CellGrid, rotation: F32) -> DescribedPoints:
    rotated = points.copy()
    rotated[:, :2] = rotated[:, :2] @ rotation.T
    return describe(rotated, cells)


def observable(example: Example, previous: Mask, current: Mask, config: CropConfig) -> F32:
    """Return (K+1,) 1 for objects with enough points in both sweeps; the last is the background.

    `previous` (N,) and `current` (M,) tell which points lie on the crop.
    """
    count = len(example.centre_m) + 1
    then = np.bincount(example.previous_object[previous] + 1, minlength=count)[1:]
    now = np.bincount(example.current_object[current] + 1, minlength=count)[1:]
    enough = (then >= config.min_previous_points) & (now >= config.min_current_points)
    return np.append(enough, True).astype(np.float32)


def _seen(example: Example, cells: CellGrid, rotation: F32) -> F32:
    """Sample the visibility rasters at the rotated cells; outside of them all is unseen."""
    x = cells.x_min_m + (np.arange(cells.columns) + 0.5) * cells.cell_m
    y = cells.y_min_m + (np.arange(cells.rows) + 0.5) * cells.cell_m
    centres = np.stack(np.broadcast_arrays(x[None], y[:, None]), axis=-1).reshape(-1, 2) @ rotation
    rows, columns, inside = EXAMPLE_GRID.cells(centres)
    seen = example.seen[:, rows, columns].astype(np.float32) / 100
    seen[:, ~inside] = np.array([1, 0, 1, 0], np.float32)[:, None]
    return seen.reshape(4, cells.rows, cells.columns).astype(np.float32)


@compiled(nogil=True)
def _cell_means(values: F32, cells: I64, count: int) -> tuple[F32, Mask]:
    """Average `values` (N,K) over the points of each cell: (count,K), and where there is any."""
    sums = np.zeros((count, values.shape[1]), np.float32)
    points = np.zeros(count, np.float32)
    for i in range(len(cells)):
        points[cells[i]] += 1.0
        for k in range(values.shape[1]):
            sums[cells[i], k] += values[i, k]
    for cell in range(count):
        if points[cell] > 0.0:
            for k in range(values.shape[1]):
                sums[cell, k] /= points[cell]
    return sums, points > 0.0


@dataclass(frozen=True)
class Batch:
    """Input and truth of one step."""

    pair: NetworkInput
    target: Target

    def to(self, device: torch.device) -> Batch:
        """Copy to a device."""
        return Batch(self.pair.to(device), self.target.to(device))


@dataclass(frozen=True)
class Sampler:
    """Draws crops from examples."""

    examples: Sequence[Example]
    cell_m: float
    """Edge of a pillar."""
    crop: CropConfig
    augmentation: AugmentationConfig
    seed: int
    """Of the whole stream."""

    def draw(self, step: int, row: int) -> Crop:
        """Draw row `row` of step `step`: a function of the seed and these two alone."""
        rng = np.random.default_rng((self.seed, step, row))
        example = self.examples[int(rng.integers(len(self.examples)))]
        example = augment(example, self.augmentation, rng)
        rotation = random_rotation(rng) if self.augmentation.rotate else NO_ROTATION
        corner = rotation @ crop_centre(example, self.crop, rng) - self.crop.size_m / 2
        side = round(self.crop.size_m / self.cell_m)
        cells = CellGrid(float(corner[0]), float(corner[1]), self.cell_m, side, side)
        crop = cut(example, cells, rotation, self.crop)
        if rng.random() < self.augmentation.no_visibility_share:
            crop = replace(crop, shares=np.zeros_like(crop.shares))
        if len(crop.older) and rng.random() < self.augmentation.no_older_share:
            crop = without_older(crop, int(rng.integers(len(crop.older))))
        return crop

    def batch(self, step: int, size: int, first: int = 0) -> Batch:
        """Draw rows `first` to `first + size` of a step."""
        return collate([self.draw(step, first + row) for row in range(size)])


def collate(crops: list[Crop]) -> Batch:
    """Join crops of one size into a batch."""
    pair = NetworkInput(
        current=_joined([crop.current for crop in crops], crops[0]),
        previous=_joined([crop.previous for crop in crops], crops[0]),
        shares=torch.from_numpy(np.stack([crop.shares for crop in crops])),
        older=tuple(
            _joined([crop.older[slot] for crop in crops], crops[0])
            for slot in range(len(crops[0].older))
        ),
        ratio=torch.from_numpy(np.stack([crop.ratio for crop in crops])),
    )
    target = Target(
        torch.from_numpy(np.stack([crop.motion_m for crop in crops])),
        torch.from_numpy(np.stack([crop.mask for crop in crops])),
        torch.tensor([crop.elapsed_s for crop in crops], dtype=torch.float32),
        torch.from_numpy(np.stack([_shadow(crop) for crop in crops])),
    )
    return Batch(pair, target)


def without_older(crop: Crop, kept: int) -> Crop:
    """Return the crop without the older sweeps from number `kept` on."""
    nothing = DescribedPoints(
        np.zeros((0, DESCRIPTORS), np.float32), np.zeros(0, np.int64), np.zeros(0, np.bool_)
    )
    older = (*crop.older[:kept], *[nothing] * (len(crop.older) - kept))
    return replace(crop, older=older, ratio=crop.ratio * (np.arange(len(older)) < kept))


def _shadow(crop: Crop) -> F32:
    """Return (1,rows,columns) the share of a cell's points that the other sweep did not return."""
    return crop.shares[4:5] + crop.shares[5:6]


def _joined(sweeps: list[DescribedPoints], crop: Crop) -> PointBatch:
    """Join the points of several sweeps, each on a grid of the size of `crop`."""
    _, rows, columns = crop.mask.shape
    descriptors = np.concatenate([one.descriptors for one in sweeps])
    cells = np.concatenate([one.cells + i * rows * columns for i, one in enumerate(sweeps)])
    return PointBatch(
        torch.from_numpy(descriptors), torch.from_numpy(cells), len(sweeps), rows, columns
    )


def stream(
    sampler: Sampler, steps: range, size: int, *, first: int = 0, workers: int = 1
) -> Iterator[Batch]:
    """Yield the batches of `steps`, made ahead by threads (the loops release the GIL)."""
    with ThreadPoolExecutor(max_workers=workers) as pool:
        waiting: deque[Future[Batch]] = deque()
        for step in steps:
            waiting.append(pool.submit(sampler.batch, step, size, first))
            if len(waiting) > 2 * workers:  # one in work and one ready for each thread
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()

"""Batches as a pure function of (seed, step): resuming needs no state of the stream."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch

from mottrack.flow.pillarflow.network import NetworkInput, PointBatch
from mottrack.flow.pillarflow.pillars import CellGrid, DescribedPoints
from mottrack.flow.pillarflow.training.augmentation import AugmentationConfig, augment
from mottrack.flow.pillarflow.training.crop import (
    NO_ROTATION,
    Crop,
    CropConfig,
    crop_centre,
    cut,
    random_rotation,
)
from mottrack.flow.pillarflow.training.examples import Example
from mottrack.flow.pillarflow.training.losses import Target


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
            crop = replace(crop, seen=np.zeros_like(crop.seen))
        return crop

    def batch(self, step: int, size: int, first: int = 0) -> Batch:
        """Draw rows `first` to `first + size` of a step."""
        return collate([self.draw(step, first + row) for row in range(size)])


def collate(crops: list[Crop]) -> Batch:
    """Join crops of one size into a batch."""
    pair = NetworkInput(
        current=_joined([crop.current for crop in crops], crops[0]),
        previous=_joined([crop.previous for crop in crops], crops[0]),
        visibility=torch.from_numpy(np.stack([crop.seen for crop in crops])),
    )
    target = Target(
        torch.from_numpy(np.stack([crop.motion_m for crop in crops])),
        torch.from_numpy(np.stack([crop.mask for crop in crops])),
        torch.tensor([crop.elapsed_s for crop in crops], dtype=torch.float32),
    )
    return Batch(pair, target)


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

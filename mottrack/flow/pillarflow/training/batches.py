"""Batches as a pure function of (seed, step): resuming needs no state of the stream."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch

from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.network import SweepPair
from mottrack.flow.pillarflow.pillar_net import Points
from mottrack.flow.pillarflow.training.augmentation import AugmentationConfig, augmented
from mottrack.flow.pillarflow.training.crop import Crop, CropConfig, crop_centre, cut, turn
from mottrack.flow.pillarflow.training.example import Example
from mottrack.flow.pillarflow.training.losses import Target


@dataclass(frozen=True)
class Batch:
    """Input and truth of one step."""

    pair: SweepPair
    """What the network sees."""
    target: Target
    """What it should say."""

    def to(self, device: torch.device) -> Batch:
        """Copy to a device."""
        return Batch(self.pair.to(device), self.target.to(device))


@dataclass(frozen=True)
class Sampler:
    """Draws crops from examples."""

    examples: Sequence[Example]
    """Where to draw from."""
    cell_m: float
    """Edge of a pillar."""
    crop: CropConfig
    """What to cut out."""
    augmentation: AugmentationConfig
    """How to change it."""
    seed: int
    """Of the whole stream."""

    def draw(self, step: int, row: int) -> Crop:
        """Row `row` of step `step`: always the same one."""
        rng = np.random.default_rng((self.seed, step, row))
        example = self.examples[int(rng.integers(len(self.examples)))]
        example = augmented(example, self.augmentation, rng)
        turned = turn(rng) if self.augmentation.rotate else np.eye(2, dtype=np.float32)
        corner = turned @ crop_centre(example, self.crop, rng) - self.crop.size_m / 2
        side = round(self.crop.size_m / self.cell_m)
        cells = CellGrid(float(corner[0]), float(corner[1]), self.cell_m, side, side)
        crop = cut(example, cells, turned, self.crop)
        if rng.random() < self.augmentation.blind_share:
            crop = replace(crop, seen=np.zeros_like(crop.seen))
        return crop

    def batch(self, step: int, size: int, first: int = 0) -> Batch:
        """Rows `first` to `first + size` of a step."""
        return collate([self.draw(step, first + row) for row in range(size)])


def collate(crops: list[Crop]) -> Batch:
    """Join crops of one size into a batch."""
    shape = (len(crops), *crops[0].mask.shape[1:])
    pair = SweepPair(
        current=_joined([crop.current for crop in crops], shape),
        previous=_joined([crop.previous for crop in crops], shape),
        visibility=torch.from_numpy(np.stack([crop.seen for crop in crops])),
    )
    target = Target(
        torch.from_numpy(np.stack([crop.motion_m for crop in crops])),
        torch.from_numpy(np.stack([crop.mask for crop in crops])),
        torch.tensor([crop.elapsed_s for crop in crops], dtype=torch.float32),
    )
    return Batch(pair, target)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]], shape: tuple[int, int, int]) -> Points:
    area = shape[1] * shape[2]
    descriptors = np.concatenate([part[0] for part in parts])
    cells = np.concatenate([part[1] + row * area for row, part in enumerate(parts)])
    return Points(torch.from_numpy(descriptors), torch.from_numpy(cells), shape)


def stream(
    sampler: Sampler, steps: range, size: int, *, first: int = 0, workers: int = 1
) -> Iterator[Batch]:
    """Batches of `steps`, made ahead by threads (the loops release the interpreter's lock)."""
    with ThreadPoolExecutor(max_workers=workers) as pool:
        waiting: deque[Future[Batch]] = deque()
        for step in steps:
            waiting.append(pool.submit(sampler.batch, step, size, first))
            if len(waiting) > 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()

"""A seeded run with births, deaths, gaps and irregular steps, as node batches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mottrack.trackers.fixed_lag.nodes import NodeBatch


@dataclass(frozen=True)
class Step:
    batch: NodeBatch
    ended: list[int]
    """Slots whose tracks died before this step."""


def covariances(rng: np.random.Generator, count: int, low: float) -> NDArray[np.float64]:
    half = rng.normal(size=(count, 2, 2)) * 0.2
    return half @ half.transpose(0, 2, 1) + low * np.eye(2)


def scenario(frames: int, slots: int, seed: int = 0) -> Iterator[Step]:
    rng = np.random.default_rng(seed)
    state = np.zeros((slots, 4))
    alive = np.zeros(slots, np.bool_)
    stamp_ns = 1_000_000_000
    for _ in range(frames):
        gap_ns = int(rng.uniform(0.07, 0.13) * 1e9) + (int(1e8) if rng.random() < 0.05 else 0)
        stamp_ns += gap_ns
        state[:, :2] += state[:, 2:] * gap_ns * 1e-9
        dies = alive & (rng.random(slots) < 0.05)
        born = dies | ~alive
        state[born] = np.column_stack(
            [rng.uniform(-80, 80, (born.sum(), 2)), rng.normal(0, 8, (born.sum(), 2))]
        )
        seen = rng.random(slots) < 0.85
        ended = np.flatnonzero(dies).tolist()
        birth = born & seen
        alive = (alive & ~dies) | birth
        rows = np.flatnonzero(seen)
        noise = covariances(rng, len(rows), 0.04)
        batch = NodeBatch(
            stamp_ns=stamp_ns,
            slot=rows,
            birth=birth[rows],
            position_m=state[rows, :2] + 0.3 * rng.normal(size=(len(rows), 2)),
            position_covariance_m2=noise,
            velocity_mps=state[rows, 2:] + 0.5 * rng.normal(size=(len(rows), 2)),
            velocity_covariance_m2ps2=covariances(rng, len(rows), 0.1),
            has_velocity=rng.random(len(rows)) < 0.8,
            extent_m=np.full(len(rows), 4.5),
            weight=np.where(rng.random((len(rows), 2)) < 0.1, 0.3, 1.0),
            innovation=np.where(rng.random((len(rows), 2)) < 0.03, 5.0, 1.0),
        )
        yield Step(batch, ended)

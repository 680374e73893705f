"""An endless, unkind drive for trackers, and a record of how their states fare."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects, Tracks

OBJECTS = 4
EPOCH = 1000
"""Steps in one place and at one scale."""
FARTHEST_M = 1e7


def hostile_drive(rng: np.random.Generator, steps: int) -> Iterator[Objects]:
    """Yield the objects of each step: a few that move steadily, seen with noise or missed."""
    stamp_ns = 0
    for step in range(steps):
        if step % EPOCH == 0:
            scale = 10.0 ** rng.uniform(-2, 3)
            place_m = rng.uniform(-FARTHEST_M, FARTHEST_M, 3) * 10.0 ** rng.uniform(-4, 0)
            place_m = place_m + 30.0 * scale * rng.normal(size=(OBJECTS, 3))
            speed_mps = scale * rng.normal(size=(OBJECTS, 3)) * [1.0, 1.0, 0.01]
        elapsed_s = 10.0 ** (rng.uniform(1.5, 4) if rng.random() < 0.01 else rng.uniform(-4, 1.5))
        stamp_ns += max(int(elapsed_s * 1e9), 1)
        place_m = place_m + speed_mps * min(elapsed_s, 1.0)  # it stands still for the rest of it
        seen = rng.random(OBJECTS) < 0.7
        n = int(seen.sum())
        root = scale * rng.normal(size=(n, 2, 2)) * 10.0 ** rng.uniform(-2, 0)
        covariance = root @ root.swapaxes(1, 2) + 1e-6 * scale**2 * np.eye(2)
        velocity = VelocityMeasurement(
            speed_mps[seen, :2] + scale * rng.normal(size=(n, 2)), covariance, rng.random(n) < 0.5
        )
        yield Objects(
            stamp_ns=stamp_ns,
            centre_m=place_m[seen] + 0.1 * scale * rng.normal(size=(n, 3)),
            size_m=scale * rng.uniform(0.5, 2.0, (n, 3)),
            yaw_rad=rng.uniform(-np.pi, np.pi, n),
            label=np.full(n, "car"),
            score=rng.random(n),
            velocity=velocity if rng.random() < 0.7 else None,
        )


class Health:
    """What was met in the tracks of many steps, of correlations: without a unit."""

    def __init__(self) -> None:
        self.tracks, self.not_finite = 0, 0
        self.asymmetry, self.smallest = 0.0, np.inf

    def add(self, tracks: Tracks) -> None:
        """Take the tracks of the next step."""
        self.tracks += len(tracks)
        if not len(tracks):
            return
        if not (np.isfinite(tracks.state).all() and np.isfinite(tracks.covariance).all()):
            self.not_finite += 1
            return
        sigma = np.sqrt(np.einsum("nii->ni", tracks.covariance))
        correlation = tracks.covariance / (sigma[:, :, None] * sigma[:, None, :])
        off = np.abs(correlation - correlation.swapaxes(1, 2)).max()
        self.asymmetry = max(self.asymmetry, float(off))
        self.smallest = min(self.smallest, float(np.linalg.eigvalsh(correlation).min()))

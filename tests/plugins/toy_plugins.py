"""Plug-ins that configurations name as ``toy_plugins:Class``."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mottrack.core import (
    BevGrid,
    DataError,
    FlowField,
    FlowSourceBase,
    Frame,
    Objects,
    Pose,
    Sweep,
    Tracks,
    Truth,
)

SPEED_MPS = 10.0


class ToyScene:
    """Two cars side by side at 10 m/s, seen every 0.1 s by a sensor at rest."""

    classes = ("car",)
    has_sweeps = True

    def __init__(self, name: str, frames: int, flag: Path | None) -> None:
        self.name, self._frames, self._flag = name, frames, flag

    def __len__(self) -> int:
        return self._frames

    def frame(self, index: int) -> Frame:
        if self.name == "poison" and index == 2:
            raise DataError(Path("toy/poison.bin"), "point 7", "nan", "a finite number")
        if self.name == "bug" and index == 2:
            raise KeyError("bug")
        if self.name == "killed" and index == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        if self._flag is not None and index == 2 and self._flag.exists():
            self._flag.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        boxes = {
            "stamp_ns": index * 10**8,
            "centre_m": self._centres(index),
            "size_m": np.tile([4.0, 2.0, 1.5], (2, 1)),
            "yaw_rad": np.zeros(2),
            "label": np.array(["car", "car"]),
        }
        truth = Truth(
            **boxes,
            id=np.array([1, 2]),
            velocity_mps=np.tile([SPEED_MPS, 0.0], (2, 1)),
            num_points=np.array([9, 9]),
            interpolated=np.zeros(2, bool),
        )
        detections = Objects(**boxes, score=np.array([0.9, 0.8]))
        return Frame(
            index * 10**8, Pose.identity(), detections, truth, token=f"{self.name}-{index}"
        )

    def sweep(self, index: int) -> Sweep:
        rng = np.random.default_rng(index)
        parts = [rng.uniform(-0.4, 0.4, (30, 3)) * [4, 2, 1.5] + c for c in self._centres(index)]
        ground = np.column_stack([rng.uniform(-45, 45, (20_000, 2)), rng.normal(0, 0.01, 20_000)])
        xyz_m = np.concatenate([*parts, ground]).astype(np.float32)
        return Sweep(
            xyz_m, np.zeros(len(xyz_m)), index * 10**8, Pose.identity(), np.array([0, 0, 1.8])
        )

    def _centres(self, index: int) -> np.ndarray:
        x = -8 + SPEED_MPS * 0.1 * index
        return np.array([[x, 6.0, 0.9], [x, -6.0, 0.9]])


class ToyDataset:
    """Scenes by name; its settings are plain arguments."""

    name = "toy"

    def __init__(
        self, scenes: tuple[str, ...] = ("a", "b"), frames: int = 8, flag: str | None = None
    ) -> None:
        self.scene_names = tuple(scenes)
        self._frames, self._flag = frames, None if flag is None else Path(flag)

    def scene(self, name: str) -> ToyScene:
        return ToyScene(name, self._frames, self._flag if name == self.scene_names[-1] else None)


class ConstantFlow(FlowSourceBase):
    """Measures one speed along x wherever the sweep has a point: the true one if not told else."""

    def __init__(self, speed_mps: float = SPEED_MPS, *, grid: BevGrid) -> None:
        self.grid, self.speed_mps = grid, speed_mps

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        del past  # the velocity is constant
        grid = self.grid
        occupied = grid.occupancy(current.xyz_m[current.xyz_m[:, 2] > 0.3])
        shape = grid.shape
        return FlowField(
            grid=grid,
            velocity_mps=np.where(occupied[..., None], [self.speed_mps, 0.0], 0.0),
            covariance_m2ps2=np.tile(0.01 * np.eye(2), (*shape, 1, 1)),
            occupied=occupied,
            valid=occupied,
            weight=occupied.astype(np.float32),
            stamp_ns=current.stamp_ns,
        )


class EchoTracker:
    """Returns the objects as tracks; identities are the rows."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        n = len(objects)
        velocity = objects.velocity
        return Tracks(
            stamp_ns=stamp_ns,
            centre_m=objects.centre_m,
            size_m=objects.size_m,
            yaw_rad=objects.yaw_rad,
            label=objects.label,
            id=np.arange(n),
            score=objects.score,
            velocity_mps=np.zeros((n, 2)) if velocity is None else velocity.mean_mps,
            velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
            state=np.zeros((n, 1)),
            covariance=np.ones((n, 1, 1)),
            observed=np.ones(n, bool),
        )


class FailingTracker(EchoTracker):
    """Fails at the third frame."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        return super().step(stamp_ns + 0 // (2 - stamp_ns // 10**8), objects)

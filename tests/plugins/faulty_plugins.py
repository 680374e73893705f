"""Parts with faults, which a configuration names as ``faulty_plugins:Class``."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np

from mottrack import BevGrid, FlowField, Sweep
from mottrack.core import DataError, FlowSourceBase, Frame
from mottrack.core.interfaces import ObjectSourceBase
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.datasets.synthetic.scene import SyntheticScene


class FaultyWorld(SyntheticDataset):
    """The embedded world; its second scene raises, its third kills the process, every time."""

    def scene(self, name: str) -> SyntheticScene:
        scene = super().scene(name)
        frame, number = scene.frame, self.scene_names.index(name)

        def faulty(index: int) -> Frame:
            if index == 3 and number == 1:
                raise DataError(Path("world.bin"), "point 7", "nan", "a finite number")
            if index == 3 and number == 2:
                os.kill(os.getpid(), signal.SIGKILL)
            return frame(index)

        scene.frame = faulty  # type: ignore[method-assign]
        return scene


class SilentFlow(FlowSourceBase):
    """Forgets to return its field."""

    def __init__(self, *, grid: object) -> None: ...

    def estimate(self, *_sweeps: object) -> None: ...


class SilentObjects(ObjectSourceBase):
    """Forgets to return its objects."""

    def objects(self, *_given: object) -> None: ...


class SilentTracker:
    """Forgets to return its tracks."""

    def step(self, *_given: object) -> None: ...


class CarelessFlow(FlowSourceBase):
    """Measures every occupied cell, with covariances that are none, or of another stamp."""

    def __init__(self, fault: str = "nan", *, grid: BevGrid) -> None:
        self.grid, self.fault = grid, fault

    def estimate(self, _past: object, current: Sweep) -> FlowField:
        covariances = {
            "nan": np.full((2, 2), np.nan),
            "negative": -np.eye(2),
            "asymmetric": np.array([[1.0, 0.5], [0.0, 1.0]]),
        }
        occupied = self.grid.occupancy(current.xyz_m)
        covariance = covariances.get(self.fault, np.eye(2))
        return replace(
            FlowField.unmeasured(self.grid, occupied, current.stamp_ns),
            covariance_m2ps2=np.broadcast_to(covariance, (*self.grid.shape, 2, 2)),
            valid=occupied,
            stamp_ns=current.stamp_ns + (self.fault == "stamp"),
        )

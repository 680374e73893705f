"""Parts with faults, which a configuration names as ``faulty_plugins:Class``."""

from __future__ import annotations

import os
import signal
from pathlib import Path

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

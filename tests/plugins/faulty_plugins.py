"""A data set that a configuration names as ``faulty_plugins:FaultyWorld``."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from mottrack.core import DataError, Frame
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

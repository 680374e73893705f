"""A tracker with known errors."""

from __future__ import annotations

import numpy as np
from toy_plugins import EchoTracker

from mottrack.core import Objects, Tracks


class LossyTracker(EchoTracker):
    """Loses the first object for two of its steps, and finds it again."""

    def __init__(self) -> None:
        self._steps = 0

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        self._steps += 1
        kept = np.arange(len(objects)) > (0 if self._steps in (4, 5) else -1)
        return super().step(stamp_ns, objects).select(kept)

"""Seconds that each stage of each frame took."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray


class Stopwatch:
    """Adds up, per key frame, the wall time of named stages."""

    def __init__(self) -> None:
        self._frames: list[dict[str, float]] = [{}]

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Times a ``with`` block as part of ``stage``."""
        start = time.perf_counter()
        yield
        frame = self._frames[-1]
        frame[stage] = frame.get(stage, 0.0) + time.perf_counter() - start

    def next_frame(self) -> None:
        """What follows belongs to the next key frame."""
        self._frames.append({})

    def seconds(self) -> dict[str, NDArray[np.float64]]:
        """Per stage (T,) seconds of each finished key frame; 0 where a stage did not run."""
        frames = self._frames[:-1]
        stages = dict.fromkeys(stage for frame in frames for stage in frame)
        return {s: np.array([frame.get(s, 0.0) for frame in frames]) for s in stages}

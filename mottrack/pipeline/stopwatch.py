"""Seconds that each stage of each frame took."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.timing import collect_timings


class Stopwatch:
    """Adds up the wall time of named stages: per key frame, and per lap."""

    def __init__(self) -> None:
        self._frames: list[dict[str, float]] = [{}]
        self._lap: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Times a ``with`` block as ``stage``, and its parts as ``stage.part``."""
        start = time.perf_counter()
        with collect_timings(lambda part, seconds: _add(self._lap, f"{stage}.{part}", seconds)):
            yield
        seconds = time.perf_counter() - start
        _add(self._frames[-1], stage, seconds)
        _add(self._lap, stage, seconds)

    def lap(self) -> dict[str, float]:
        """Seconds by stage, and by part of a stage, since the last lap; a new one begins."""
        lap, self._lap = self._lap, {}
        return lap

    def next_frame(self) -> None:
        """What follows belongs to the next key frame."""
        self._frames.append({})

    def seconds(self) -> dict[str, F64]:
        """Per stage (T,) seconds of each finished key frame; 0 where a stage did not run."""
        frames = self._frames[:-1]
        stages = dict.fromkeys(stage for frame in frames for stage in frame)
        return {s: np.array([frame.get(s, 0.0) for frame in frames]) for s in stages}


def _add(totals: dict[str, float], name: str, seconds: float) -> None:
    totals[name] = totals.get(name, 0.0) + seconds

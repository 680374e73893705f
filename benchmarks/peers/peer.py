"""What every peer takes and returns, in plain arrays: the peers' environment has no mottrack."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np


class Detected(NamedTuple):
    """The detections of a frame."""

    stamp_ns: int
    box: np.ndarray
    """(N, 7) x, y, z, length, width, height, yaw; metres, radians, world frame."""
    label: np.ndarray
    """(N,) index of the class."""
    score: np.ndarray
    """(N,)"""


class Found(NamedTuple):
    """The tracks of a frame."""

    box: np.ndarray
    """(M, 7) as in `Detected`."""
    label: np.ndarray
    """(M,)"""
    score: np.ndarray
    """(M,)"""
    id: np.ndarray
    """(M,) identity, unique within the stream."""
    velocity: np.ndarray
    """(M, 2) metres per second; NaN where the peer gives none."""


class Peer(Protocol):
    """A tracker of others. Only `step` is timed."""

    def prepared(self, seen: Detected) -> Any:
        """Return the detections as the peer's own objects."""

    def step(self, prepared: Any) -> Any:
        """Advance by a frame and return what the peer returns."""

    def found(self, returned: Any) -> Found:
        """Return its tracks as arrays; called after each step."""


def table(rows: list[tuple[float, ...]]) -> Found:
    """Return tracks from rows of seven box numbers, label, score, id, and two of velocity."""
    numbers = np.array(rows, np.float64).reshape(len(rows), 12)
    label, identity = numbers[:, 7].astype(np.int64), numbers[:, 9].astype(np.int64)
    return Found(numbers[:, :7], label, numbers[:, 8], identity, numbers[:, 10:])

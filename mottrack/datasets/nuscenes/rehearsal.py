"""Scenes of the embedded world with what makes the real nuScenes hard to read."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mottrack.core import Frame, Scene, Sweep, Truth
from mottrack.core.arrays import F64
from mottrack.core.objects import Boxes
from mottrack.datasets.nuscenes.own_body import with_own_body
from mottrack.formats.nuscenes_classes import RACK_CATEGORY, RACKED_CLASSES

FIRST_RACK_ID = 1_000_000
"""Far above the identities of the world's road users."""
RACK_MARGIN_M = np.array([1.0, 1.0, 0.5])
"""A rack is longer than the bicycle that stands in it."""
EMPTY_RACK_M = np.array([12.0, -9.0, 0.6])
"""Where a rack stands in a street without parked bicycles: on the pavement, ahead of the car."""
EMPTY_RACK_SIZE_M = np.array([4.0, 1.8, 1.2])
OFF_CENTRE_M = np.array([0.3, 0.0, 0.0])
"""Nobody parks in the very middle; and two boxes at one place would be hard to tell apart."""
STANDING_MPS = 0.05
"""Slower two-wheelers stand: the world's parked ones move by no noise at all."""


class RehearsalScene:
    """A scene with bicycle racks in its truth and returns of the own body in its sweeps.

    Each two-wheeler that stands in the first frame stands in a rack, which nuScenes annotates with
    a box around it. Where none stands, the one with most returns passes through a rack, and in a
    scene without two-wheelers there is an empty one.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.name, self.classes, self.has_sweeps = scene.name, scene.classes, scene.has_sweeps

    def __len__(self) -> int:
        return len(self._scene)

    def frame(self, index: int) -> Frame:
        """Return the frame with the racks among its truth."""
        frame = self._scene.frame(index)
        if frame.truth is None:
            return frame
        racks = replace(self._racks, stamp_ns=frame.stamp_ns)
        return replace(frame, truth=_joined(frame.truth, racks))

    def sweep(self, index: int) -> Sweep:
        """Return the sweep with the body of the vehicle in the way of its beams."""
        return with_own_body(self._scene.sweep(index), self._velocity(index))

    def _velocity(self, index: int) -> F64:
        """Return the velocity (3,) of the vehicle in its own axes, from its poses."""
        if len(self) < 2:
            return np.zeros(3)
        before, after = (self._scene.frame(i) for i in (max(index - 1, 0), max(index, 1)))
        way = before.world_T_ego.inverse().apply(after.world_T_ego.translation_m[None])[0]
        return np.asarray(way / ((after.stamp_ns - before.stamp_ns) * 1e-9))

    @cached_property
    def _racks(self) -> Truth:
        frame = self._scene.frame(0)
        found = [] if frame.truth is None else [_around(frame.truth)]
        if found and len(found[0]):
            return found[0]
        centre_m = frame.world_T_ego.apply(EMPTY_RACK_M[None])
        return _racks(frame, centre_m, EMPTY_RACK_SIZE_M[None], np.zeros(1))


def _around(truth: Truth) -> Truth:
    """Return a rack around each two-wheeler that stands, or around the one best seen."""
    rows = truth.select(np.isin(truth.label, RACKED_CLASSES))
    standing = np.hypot(*rows.velocity_mps.T) < STANDING_MPS
    if len(rows) and not standing.any():
        standing[np.argmax(rows.num_points)] = True
    rows = rows.select(standing)
    return _racks(rows, rows.centre_m + OFF_CENTRE_M, rows.size_m + RACK_MARGIN_M, rows.yaw_rad)


def _racks(at: Frame | Boxes, centre_m: F64, size_m: F64, yaw_rad: F64) -> Truth:
    count = len(centre_m)
    return Truth(
        stamp_ns=at.stamp_ns,
        frame="world",
        centre_m=centre_m,
        size_m=size_m,
        yaw_rad=yaw_rad,
        label=np.full(count, RACK_CATEGORY),
        id=np.arange(count) + FIRST_RACK_ID,
        velocity_mps=np.zeros((count, 2)),
        num_points=np.full(count, -1),
        interpolated=np.zeros(count, dtype=np.bool_),
    )


def _joined(first: Truth, second: Truth) -> Truth:
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in Truth.COLUMNS
    }
    return replace(first, **columns)

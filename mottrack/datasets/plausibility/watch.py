"""Watches a scene while it is read; says at its end what is unlikely."""

from __future__ import annotations

import numpy as np

from mottrack.core import Boxes, Frame, Scene, Sweep
from mottrack.core.concerns import Concern
from mottrack.datasets.plausibility.boxes import box_concerns
from mottrack.datasets.plausibility.motion import FEWEST, motion_concerns
from mottrack.datasets.plausibility.seen import SeenScene
from mottrack.lidar.in_boxes import points_in_boxes

NEAR_M = 40.0
"""Within it a box of a data set's class holds returns unless something hides it."""
FEWEST_KEY_FRAMES = 10
"""A second at 10 Hz, five at 2 Hz: in fewer a road may well be empty."""


def scene_concerns(scene: SeenScene) -> list[Concern]:
    """Return what is unlikely in a scene."""
    moving = motion_concerns(scene) if len(scene.stamp_ns) > 1 else ()
    return [*moving, *box_concerns(scene)]


class SceneWatch:
    """Gathers the frames of a scene, and how many of its boxes hold returns."""

    def __init__(self, scene: Scene) -> None:
        self._classes = tuple(scene.classes)
        self._left_out = tuple(getattr(scene, "concerns", ()))
        self._frames: list[Frame] = []
        self._lost_ns: list[int] = []
        self._near = {"annotations": [0, 0], "detections": [0, 0]}

    def add(self, frame: Frame, sweep: Sweep | None = None) -> None:
        """Take the next frame; with its sweep, the returns in its boxes are counted."""
        self._frames.append(frame)
        if sweep is not None and self._has_points(sweep):
            for what, boxes in (("annotations", frame.truth), ("detections", frame.detections)):
                if boxes is not None:
                    self._count(self._near[what], boxes, frame, sweep)

    def add_unseen(self, frame: Frame, sweep: Sweep | None = None) -> None:
        """Take the next frame without counting the returns in its boxes, which takes time."""
        self._frames.append(frame)
        if sweep is not None:
            self._has_points(sweep)

    def _has_points(self, sweep: Sweep) -> bool:
        if not len(sweep):
            self._lost_ns.append(sweep.stamp_ns)
        return len(sweep) > 0

    def concerns(self) -> list[Concern]:
        """Return what is unlikely in the frames so far."""
        found = list(self._left_out)
        if self._lost_ns:
            text = f"at frame {self._lost_ns[0]}"
            found.append(Concern("sweeps that are missing or empty", len(self._lost_ns), text))
        if self._frames:
            found += scene_concerns(SeenScene.of_frames(self._frames, self._classes))
            found += self._without_returns()
            found += self._without_detections()
        return found

    def _count(self, numbers: list[int], boxes: Boxes, frame: Frame, sweep: Sweep) -> None:
        ego = boxes.transformed(frame.world_T_ego.inverse(), "ego")
        ego = ego.select(np.hypot(*ego.centre_m[:, :2].T) < NEAR_M)
        inside = points_in_boxes(sweep.xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
        numbers[0] += len(ego)
        numbers[1] += int(np.count_nonzero(np.diff(inside.start) == 0))

    def _without_detections(self) -> list[Concern]:
        """Return a concern if a detector found nothing in any of many key frames."""
        found = [f.detections for f in self._frames if f.is_key and f.detections is not None]
        if len(found) < FEWEST_KEY_FRAMES or any(map(len, found)):
            return []
        text = f"at frame {found[0].stamp_ns}: no frame of the scene has a detection"
        return [Concern("key frames without a detection", len(found), text)]

    def _without_returns(self) -> list[Concern]:
        found = []
        for what, (near, empty) in self._near.items():
            if near >= FEWEST and empty > near / 2:
                text = f"of {near} within {NEAR_M:g} m (another frame, or mirrored points?)"
                found.append(Concern(f"{what} that no point lies in", empty, text))
        return found

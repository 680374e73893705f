"""A scene run backwards in time."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mottrack.core.frame import Frame
from mottrack.core.interfaces import Scene
from mottrack.core.sweep import Sweep


@dataclass(frozen=True)
class MirroredScene:
    """The frames of a scene from the last to the first, with stamps that grow all the same.

    Any flow source that is fed with it gives, at the points of a sweep, the velocity towards the
    NEXT sweep of the recording, with its sign turned. That is the flow that the scene flow
    challenges ask for; fed forwards a source says where the points of a sweep came from.
    """

    scene: Scene

    def __len__(self) -> int:
        return len(self.scene)

    def original(self, index: int) -> int:
        """Return the index of the same frame in the recording."""
        return len(self.scene) - 1 - index

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`; measured velocities of detections are left out."""
        return mirrored_frame(self.scene.frame(self.original(index)), self._end_ns)

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`; the order in which its points were measured is turned too.

        Raises:
            DataError: the file is missing or damaged.
        """
        return mirrored_sweep(self.scene.sweep(self.original(index)), self._end_ns)

    @property
    def _end_ns(self) -> int:
        return self.scene.frame(len(self.scene) - 1).stamp_ns


def mirrored_frame(frame: Frame, about_ns: int) -> Frame:
    """Return a frame with time turned about a stamp; velocities of detections are left out."""
    stamp_ns = 2 * about_ns - frame.stamp_ns
    truth, found = frame.truth, frame.detections
    return replace(
        frame,
        stamp_ns=stamp_ns,
        truth=truth and replace(truth, stamp_ns=stamp_ns, velocity_mps=-truth.velocity_mps),
        detections=found and replace(found, stamp_ns=stamp_ns, velocity=None),
    )


def mirrored_sweep(sweep: Sweep, about_ns: int) -> Sweep:
    """Return a sweep with time turned about a stamp, also the order of its points."""
    offset_ns = sweep.time_offset_ns
    return replace(
        sweep,
        stamp_ns=2 * about_ns - sweep.stamp_ns,
        time_offset_ns=None if offset_ns is None else -offset_ns,
    )

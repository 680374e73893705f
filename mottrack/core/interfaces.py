"""What the parts promise each other. A user's own class need only have these methods."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

from mottrack.core.arrays import F64
from mottrack.core.frame import Frame
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects, Tracks
from mottrack.core.sweep import Sweep


@runtime_checkable
class FlowSource(Protocol):
    """Measures the velocity of every cell from two sweeps.

    An attribute ``faults`` (a `VelocityErrorModel`) may say how it errs beside its covariance.
    """

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The field at ``current``; each sweep is in its own ego frame.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        ...

    def reset(self) -> None:
        """Forgets everything: a new scene begins."""
        ...


@runtime_checkable
class FrameObserver(Protocol):
    """A flow source that also looks at detections or truth (ICP + Det., ground truth)."""

    def observe(self, frame: Frame) -> None:
        """Is called with every frame, in order, before ``estimate`` of its sweep."""
        ...


@runtime_checkable
class ObjectSource(Protocol):
    """Says which objects there are: the data set's detections, or clusters of points."""

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Objects in the world frame, without velocities.

        Raises:
            InputError: the source needs a sweep and there is none, or detections and has none.
        """
        ...

    def reset(self) -> None:
        """Forgets everything: a new scene begins."""
        ...


@runtime_checkable
class GroundMap(Protocol):
    """A scene whose map knows how high the ground is (Argoverse 2)."""

    def ground_height(self, xy_m: F64) -> F64:
        """(N,) world height of the ground at (N, 2) world positions; NaN where unknown."""
        ...


@runtime_checkable
class DetectedScene(Protocol):
    """A scene that says where a detector's boxes for it are, or were looked for."""

    @property
    def detections_at(self) -> Path:
        """File, pattern of files or, where none was named, the data set's folder."""
        ...


@runtime_checkable
class GroundUser(Protocol):
    """An object source that prefers a map's ground to its own estimate."""

    def use_ground(self, ground: GroundMap) -> None:
        """Is called once, before the first frame of a scene that has a map."""
        ...


@runtime_checkable
class Tracker(Protocol):
    """Turns objects into tracks. A new one is made for each scene."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advances to ``stamp_ns`` with these objects (world frame).

        Raises:
            InputError: the stamp is not later than the last one, or an object is not usable;
                the tracker's state is then unchanged.
        """
        ...


@runtime_checkable
class OfflineTracker(Tracker, Protocol):
    """A tracker that may look at a scene again when it is over."""

    def finish(self, steps: list[Tracks]) -> list[Tracks]:
        """The scene's tracks given all of it; ``steps`` are what ``step`` returned, in order."""
        ...


@runtime_checkable
class Scene(Protocol):
    """A recorded drive: frames in order of time, with a sweep each where recorded."""

    @property
    def name(self) -> str:
        """Unique within the data set."""
        ...

    @property
    def classes(self) -> tuple[str, ...]:
        """Labels that detectors report and scores count; truth may carry others."""
        ...

    @property
    def has_sweeps(self) -> bool:
        """Whether ``sweep`` works."""
        ...

    def __len__(self) -> int: ...

    def frame(self, index: int) -> Frame:
        """The frame at ``index``."""
        ...

    def sweep(self, index: int) -> Sweep:
        """The sweep at ``index``; its stamp and pose equal the frame's.

        Raises:
            DataError: the file is missing or damaged.
        """
        ...


@runtime_checkable
class Dataset(Protocol):
    """A set of scenes."""

    @property
    def name(self) -> str:
        """Name of the data set."""
        ...

    @property
    def scene_names(self) -> tuple[str, ...]:
        """All scenes, in a fixed order."""
        ...

    def scene(self, name: str) -> Scene:
        """Opens one scene.

        Raises:
            ConfigError: no scene has that name.
            DataError: a file of it is missing or damaged.
        """
        ...

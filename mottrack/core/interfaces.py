"""Protocols that plug-ins implement, base classes with their defaults, and entries of part tables.

A class of a user's own needs no base class. But what a protocol declares as an attribute must be a
class attribute: `FlowSourceBase` and `ObjectSourceBase` have the usual values.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

from mottrack.core.arrays import F64
from mottrack.core.concerns import Concern
from mottrack.core.frame import Frame
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects, Tracks
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel


class TableEntry(NamedTuple):
    """A data set, object source, flow source or tracker that a configuration can name."""

    target: str
    """``module:Class``; imported only when it is used."""
    summary: str
    """One line for `mottrack list` and the reference."""


@runtime_checkable
class FlowSource(Protocol):
    """Measures the velocity of every cell from the current sweep and earlier ones.

    It is constructed with the keyword ``grid``, the `BevGrid` of the fields that it returns.
    """

    needs_sweeps: bool
    """Whether it reads points; where no part does, sweeps are not loaded."""
    stateful: bool
    """Whether it must receive every sweep (a filter such as DOGMa), not only key frames'."""
    past_sweeps: int
    """Earlier sweeps that it makes use of, at most; at the start of a drive there are fewer."""
    error_model: VelocityErrorModel
    """Its errors beside the covariance that it states."""

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Estimate the field at ``current``; each sweep is in its own ego frame.

        Args:
            past: one to ``past_sweeps`` earlier sweeps, from the oldest to the newest. The newest
                is the other sweep of a pair, ``pair_s`` older; the others reach back evenly to
                ``history_s``.
            current: the sweep whose cells get a velocity.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        ...

    def reset(self) -> None:
        """Start a new scene: forget all state."""
        ...


class FlowSourceBase:
    """Defaults of `FlowSource`, to inherit: flow of two sweeps that errs as its covariance says.

    `mottrack calibrate-errors` tells whether it does, and the error model if not.
    """

    needs_sweeps: bool = True
    stateful: bool = False
    past_sweeps: int = 1
    error_model: VelocityErrorModel = NO_OUTLIERS

    def reset(self) -> None:
        """Start a new scene; there is no state to forget."""


@runtime_checkable
class FrameObserver(Protocol):
    """A flow source that also reads detections or truth (ICP + Det., ground truth)."""

    def observe(self, frame: Frame) -> None:
        """Receive every frame, in order, before ``estimate`` of its sweep."""
        ...


@runtime_checkable
class ObjectSource(Protocol):
    """Provides the objects of a frame: the data set's detections, or clusters of points."""

    needs_sweeps: bool
    """Whether it reads points; where no part does, sweeps are not loaded."""
    needs_detections: bool
    """Whether it can't work without a detector's boxes; where they are missing, the error then
    names the file in which they were looked for."""

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Return objects in the world frame; with velocities only if the source measures them.

        Raises:
            InputError: the source needs a sweep and there is none, or detections and has none.
        """
        ...

    def reset(self) -> None:
        """Start a new scene: forget all state."""
        ...


class ObjectSourceBase:
    """Defaults of `ObjectSource`, to inherit: points are read, detections are not required."""

    needs_sweeps: bool = True
    needs_detections: bool = False

    def reset(self) -> None:
        """Start a new scene; there is no state to forget."""


@runtime_checkable
class GroundMap(Protocol):
    """A scene whose map holds the height of the ground (Argoverse 2)."""

    def ground_height(self, xy_m: F64) -> F64:
        """Return (N,) world height of the ground at (N, 2) world positions; NaN where unknown."""
        ...


@runtime_checkable
class GroundUser(Protocol):
    """An object source that prefers a map's ground to its own estimate."""

    def use_ground(self, ground: GroundMap) -> None:
        """Receive the map once, before the first frame of a scene that has one."""
        ...


@runtime_checkable
class DetectedScene(Protocol):
    """A scene that knows where a detector's boxes for it are stored."""

    @property
    def detections_at(self) -> Path:
        """File, pattern of files or, where none was configured, the data set's folder."""
        ...


@runtime_checkable
class Tracker(Protocol):
    """Turns objects into tracks. A new one is made for each scene."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advance to ``stamp_ns`` with these objects (world frame).

        Raises:
            InputError: the stamp is not later than the last one, or an object is not usable;
                the tracker's state is then unchanged.
        """
        ...


@runtime_checkable
class OfflineTracker(Tracker, Protocol):
    """A tracker that can smooth a scene when it is over."""

    def finish(self, steps: list[Tracks]) -> list[Tracks]:
        """Return the tracks given the whole scene; ``steps`` are the results of ``step``."""
        ...


@runtime_checkable
class VelocityJudge(Protocol):
    """A tracker that notices when measured velocities err more than their source states."""

    def velocity_concern(self) -> Concern | None:
        """Return a warning if the measured velocities were given little weight so far."""
        ...


@runtime_checkable
class Scene(Protocol):
    """A recorded drive: frames in order of time, each with a sweep where sweeps were recorded."""

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
        """Return the frame at ``index``."""
        ...

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at ``index``; its stamp and pose equal the frame's.

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
        """Open one scene.

        Raises:
            ConfigError: no scene has that name.
            DataError: a file of it is missing or damaged.
        """
        ...

"""A scene and a flow source that get worse by a damage of a given amount."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mottrack.core.arrays import F64, Floats
from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver, GroundMap, Scene
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.studies.stress.damage import (
    DAMAGES,
    DRIFT,
    FLOW_LATE,
    FLOW_LOST,
    FLOW_NOISE,
    LATE,
    Moment,
    drift_pose,
)


@dataclass(frozen=True)
class Stress:
    """A kind of damage and its amount."""

    kind: str
    amount: float

    def rng(self, name: str, number: int) -> np.random.Generator:
        """Return the draws of one frame of a scene: the same for every tracker and amount."""
        return np.random.default_rng([zlib.crc32(f"{self.kind} {name}".encode()), number])


@dataclass(frozen=True)
class StressedScene:
    """A scene whose detections, their delay or whose poses got worse; sweeps and truth stay."""

    scene: Scene
    stress: Stress
    frames: dict[int, Frame] = field(default_factory=dict)
    """Frames of the scene that were read before: damages of one scene share them."""

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    @property
    def classes(self) -> tuple[str, ...]:
        """Labels that are scored."""
        return self.scene.classes

    @property
    def has_sweeps(self) -> bool:
        """Whether `sweep` works."""
        return self.scene.has_sweeps

    def __len__(self) -> int:
        return len(self.scene)

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, worse."""
        frame = self._undamaged(index)
        if self.stress.amount == 0:
            return frame
        if self.stress.kind == LATE:
            return self._late(frame, index)
        if self.stress.kind == DRIFT:
            return self._drifted(frame)
        damage = DAMAGES[self.stress.kind].detections
        if damage is None or frame.detections is None:
            return frame
        rng = self.stress.rng(self.name, index)
        moment = Moment(frame.detections, frame.world_T_ego, self._since_s(frame), rng)
        return replace(frame, detections=damage(moment, self.stress.amount))

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at `index`, its pose that of the frame.

        Raises:
            DataError: the file is missing or damaged.
        """
        sweep = self.scene.sweep(index)
        if self.stress.kind != DRIFT:
            return sweep
        return replace(sweep, world_T_ego=self.frame(index).world_T_ego)

    def _undamaged(self, index: int) -> Frame:
        if index not in self.frames:
            self.frames[index] = self.scene.frame(index)
        return self.frames[index]

    def _since_s(self, frame: Frame) -> float:
        return seconds_between(self._undamaged(0).stamp_ns, frame.stamp_ns)

    def _late(self, frame: Frame, index: int) -> Frame:
        """Return the frame with the detections of an earlier key frame, where they were then."""
        keys = [i for i in range(index + 1) if self._undamaged(i).detections is not None]
        if frame.detections is None:
            return frame
        behind = len(keys) - 1 - round(self.stress.amount)
        if behind < 0:
            return replace(frame, detections=frame.detections.select(np.zeros(0, np.int64)))
        old = self._undamaged(keys[behind]).detections
        return replace(frame, detections=old and replace(old, stamp_ns=frame.stamp_ns))

    def _drifted(self, frame: Frame) -> Frame:
        """Return the frame where the vehicle believes to be; truth is known relative to it."""
        drift = drift_pose(self._since_s(frame), self.stress.amount)
        found, truth = frame.detections, frame.truth
        return replace(
            frame,
            world_T_ego=drift @ frame.world_T_ego,
            detections=found and found.transformed(drift, "world"),
            truth=truth and truth.transformed(drift, "world"),
        )


@dataclass(frozen=True)
class StressedMapScene(StressedScene):
    """The same of a scene whose map holds the ground."""

    ground: GroundMap = field(kw_only=True)
    """The scene."""

    def ground_height(self, xy_m: F64) -> F64:
        """Return (N,) height of the ground at (N, 2) world positions, as the scene has it."""
        return self.ground.ground_height(xy_m)


def stressed(clean: StressedScene, stress: Stress) -> StressedScene:
    """Return a scene under another damage; where poses drift it has no map: places are wrong."""
    scene = clean.scene
    if isinstance(scene, GroundMap) and stress.kind != DRIFT:
        return StressedMapScene(scene, stress, clean.frames, ground=scene)
    return StressedScene(scene, stress, clean.frames)


@dataclass
class StressedFlow:
    """A flow source whose fields got worse."""

    source: FlowSource
    stress: Stress
    _recent: deque[FlowField] = field(default_factory=deque)
    _number: int = 0

    def __post_init__(self) -> None:
        """Take over the source's traits: it does not know of the damage."""
        self.stateful: bool = self.source.stateful
        self.needs_sweeps: bool = self.source.needs_sweeps
        self.past_sweeps: int = self.source.past_sweeps
        self.error_model: VelocityErrorModel = self.source.error_model

    def observe(self, frame: Frame) -> None:
        """Hand the frame to a source that wants it."""
        if isinstance(self.source, FrameObserver):
            self.source.observe(frame)

    def reset(self) -> None:
        """Forget everything: a new scene begins."""
        self.source.reset()
        self._recent.clear()
        self._number = 0

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the field at `current`, worse.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        found = self.source.estimate(past, current)
        self._number += 1
        rng = self.stress.rng("flow", self._number)
        if self.stress.kind == FLOW_NOISE:
            noise = rng.normal(0.0, self.stress.amount, found.velocity_mps.shape)
            return _moved(found, found.velocity_mps + noise * found.valid[..., None])
        if self.stress.kind == FLOW_LOST:
            lost = rng.random(found.valid.shape) < self.stress.amount
            return _moved(found, np.where(lost[..., None], 0.0, found.velocity_mps))
        if self.stress.kind == FLOW_LATE:
            self._recent.append(found)
            while len(self._recent) > round(self.stress.amount) + 1:
                self._recent.popleft()
            old = self._recent[0]
            return replace(old, stamp_ns=found.stamp_ns)
        return found


def _moved(found: FlowField, velocity_mps: Floats) -> FlowField:
    return replace(found, velocity_mps=velocity_mps.astype(np.float32))

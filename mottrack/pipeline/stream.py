"""The chain from a sweep to tracks, fed one frame after the other, as a vehicle would."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from numpy.typing import ArrayLike

from mottrack.core.checks import as_stamp
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import (
    FlowSource,
    FrameObserver,
    GroundMap,
    GroundUser,
    ObjectSource,
    OfflineTracker,
    Tracker,
)
from mottrack.core.motion import FlowField, VelocityMeasurement, fuse_velocities
from mottrack.core.objects import Objects, Tracks
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import FLOW_ERRORS, VelocityErrorModel
from mottrack.experiment.experiment import Experiment, load_to_stream
from mottrack.objects.velocity import measure_velocity
from mottrack.pipeline.latency import TOTAL, LatencyLog, LatencyReport, StepTimes
from mottrack.pipeline.plain_input import Detections, detections_of, pose_of, sweep_of
from mottrack.pipeline.stopwatch import Stopwatch
from mottrack.pipeline.sweep_pairs import SweepPairs


@dataclass(frozen=True)
class Step:
    """What the pipeline made of one frame."""

    pair: tuple[Sweep, Sweep] | None
    """The earlier sweep and the current one; None where there is no earlier one near enough."""
    field: FlowField | None
    """The flow between them; None where it was not asked for."""
    objects: Objects | None
    """What the tracker was given, world frame, with velocities; None between key frames."""
    tracks: Tracks | None
    """World frame; None between key frames."""
    seconds: dict[str, float]
    """Wall time by stage; a part of a stage as ``stage.part``; ``total`` is the whole step."""


class Pipeline:
    """Flow, objects, their velocities and the tracker, fed sweep by sweep.

    Example:
        pipeline = Pipeline.from_config("demo", "flow=pillarflow")
        for frame, sweep in drive:
            step = pipeline.step(frame, sweep)
        print(pipeline.latency())
    """

    def __init__(self, experiment: Experiment, *, rate_hz: float = 10.0) -> None:
        """Makes every part of the experiment but the data set.

        Args:
            experiment: what to run.
            rate_hz: sweeps a second, whose inverse is the budget of a step.

        Raises:
            MottrackError: a part can't be made, or the rate is not positive.
        """
        settings = experiment.settings
        self.flow: FlowSource = experiment.flow.make(grid=settings.grid.grid())
        self.objects: ObjectSource = experiment.objects.make()
        self.watch = Stopwatch()
        self._experiment = experiment
        self._latency = LatencyLog(rate_hz)
        self._velocity = settings.velocity
        self._stateful = is_stateful(self.flow)
        self.reset()

    @classmethod
    def from_config(cls, config: str, *overrides: str, rate_hz: float = 10.0) -> Self:
        """A pipeline from an experiment file or the name of a shipped one.

        The file's data set is not looked at: the caller is the data set.

        Args:
            config: path of a YAML file, or a name such as ``"demo"``.
            overrides: ``key=value`` texts as on the command line.
            rate_hz: sweeps a second, whose inverse is the budget of a step.

        Raises:
            ConfigError: a key, a name or a value is wrong, or several variants are left.
            DataError: the file can't be read.
        """
        return cls(load_to_stream(config, overrides), rate_hz=rate_hz)

    @property
    def needs_sweeps(self) -> bool:
        """Whether any part looks at sweeps."""
        return needs_sweeps(self.flow) or needs_sweeps(self.objects)

    def reset(self) -> None:
        """A new scene begins: forgets all but the latency; loaded and compiled parts stay."""
        settings = self._experiment.settings
        self.tracker: Tracker = self._experiment.tracker.make()
        self._pairs = SweepPairs(settings.pair_s, settings.max_pair_s)
        self._stamp_ns: int | None = None
        self.flow.reset()
        self.objects.reset()

    def use_ground(self, ground: GroundMap) -> None:
        """Gives a map's heights of the ground to an object source that wants them."""
        if isinstance(self.objects, GroundUser):
            self.objects.use_ground(ground)

    def step(self, frame: Frame, sweep: Sweep | None = None) -> Step:
        """Takes in the next frame.

        Args:
            frame: later than all before; its detections and truth in the world frame.
            sweep: of the same stamp; None where no part looks at sweeps, or none arrived.

        Raises:
            InputError: the stamp is not later than the last one, or frame and sweep have different
                stamps: nothing has changed then. Or a part refuses its input: this frame is lost,
                and the pipeline goes on with the next.
        """
        self._check(frame, sweep)
        self._stamp_ns = frame.stamp_ns
        self.watch.lap()
        start = time.perf_counter()
        if isinstance(self.flow, FrameObserver):
            self.flow.observe(frame)
        pair = None if sweep is None else self._pair(sweep)
        field = self._estimate(pair) if frame.is_key or self._stateful else None
        objects = self._measured_objects(frame, sweep, field) if frame.is_key else None
        tracks = None if objects is None else self._track(frame, objects)
        seconds = self.watch.lap() | {TOTAL: time.perf_counter() - start}
        self._latency.add(seconds)
        return Step(pair, field, objects, tracks, seconds)

    def feed(
        self,
        stamp_ns: int,
        points: ArrayLike | None,
        world_T_ego: Pose | ArrayLike,
        detections: Detections | None = None,
        origin_m: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Step:
        """Takes in the next step from plain arrays.

        Args:
            stamp_ns: integer nanoseconds, later than all before.
            points: (N, 3) x, y, z or (N, 4) x, y, z, reflectance in [0, 1]; ego frame, metres,
                compensated to the stamp. None where no sweep arrived.
            world_T_ego: pose, or (4, 4) matrix, that takes the ego frame's points to the world.
            detections: `Objects`, or arrays by its names: ``frame`` ("ego" or "world"),
                ``centre_m`` (N, 3), ``size_m`` (N, 3) length, width, height, ``yaw_rad`` (N,),
                ``label`` (N,), ``score`` (N,). None where no detector ran.
            origin_m: (3,) optical centre of the LiDAR in the ego frame.

        Raises:
            InputError: an array is not usable, or what `step` says.
            ConfigError: `detections` has an unknown name.
        """
        stamp_ns, pose = as_stamp("stamp_ns", stamp_ns), pose_of(world_T_ego)
        sweep = None if points is None else sweep_of(points, stamp_ns, pose, origin_m)
        found = None if detections is None else detections_of(detections, stamp_ns, pose)
        return self.step(Frame(stamp_ns, pose, found), sweep)

    def finish(self, steps: Sequence[Tracks]) -> list[Tracks]:
        """The tracks of a scene given all of it, from a tracker that smooths; else as they were.

        Raises:
            ConfigError: the tracker can't do what its settings ask for.
        """
        if isinstance(self.tracker, OfflineTracker):
            return self.tracker.finish(list(steps))
        return list(steps)

    def latency(self) -> LatencyReport:
        """Latency of the last steps (up to an hour's at 10 Hz) against the time for one."""
        return self._latency.report()

    def step_times(self, period_s: float) -> StepTimes:
        """The times behind `latency`, to be stored; ``period_s`` is that between two sweeps."""
        return self._latency.times(period_s)

    def _check(self, frame: Frame, sweep: Sweep | None) -> None:
        if sweep is not None and sweep.stamp_ns != frame.stamp_ns:
            raise InputError(
                "stamp_ns of sweep", sweep.stamp_ns, f"that of the frame, {frame.stamp_ns}"
            )
        if self._stamp_ns is not None and frame.stamp_ns <= self._stamp_ns:
            raise InputError(
                "stamp_ns", frame.stamp_ns, f"later than that of the last step, {self._stamp_ns}"
            )

    def _pair(self, sweep: Sweep) -> tuple[Sweep, Sweep] | None:
        previous = self._pairs.push(sweep, consecutive=self._stateful)
        if previous is None and self._stateful:
            # what it remembers lies before a gap: it would refuse every sweep from here on
            self.flow.reset()
        return None if previous is None else (previous, sweep)

    def _estimate(self, pair: tuple[Sweep, Sweep] | None) -> FlowField | None:
        if pair is None:
            return None
        with self.watch("flow"):
            return self.flow.estimate(*pair)

    def _measured_objects(
        self, frame: Frame, sweep: Sweep | None, field: FlowField | None
    ) -> Objects:
        with self.watch("objects"):
            objects = self.objects.objects(frame, sweep)
        with self.watch("velocity"):
            return self._with_velocity(frame, objects, field)

    def _track(self, frame: Frame, objects: Objects) -> Tracks:
        with self.watch("tracker"):
            return self.tracker.step(frame.stamp_ns, objects)

    def _with_velocity(self, frame: Frame, objects: Objects, field: FlowField | None) -> Objects:
        if field is None or not len(objects):
            return objects
        in_ego = objects.transformed(frame.world_T_ego.inverse(), "ego")
        measured = measure_velocity(field, in_ego, self._velocity)
        measured = measured.with_error_model(error_model_of(self.flow)).rotated(
            frame.world_T_ego.yaw_rad
        )
        return objects.with_velocity(joined(objects.velocity, measured))


def joined(given: VelocityMeasurement | None, flow: VelocityMeasurement) -> VelocityMeasurement:
    """Velocities that came with the objects (a radar's, a detector's) and those of the flow.

    Faults are one statement for all rows: where any row rests on the flow alone, the flow's.
    """
    if given is None or not given.valid.any():
        return flow
    if not flow.valid.any():
        return given
    fused = fuse_velocities([given, flow])
    return fused.with_error_model(flow.error_model) if (flow.valid & ~given.valid).any() else fused


def error_model_of(source: object) -> VelocityErrorModel:
    """How a flow source errs beside its covariance; one that does not say is taken with care."""
    error_model = getattr(source, "error_model", FLOW_ERRORS)
    return error_model if isinstance(error_model, VelocityErrorModel) else FLOW_ERRORS


def is_stateful(source: object) -> bool:
    """Whether a flow source must see every sweep (DOGMa), not only the key frames'."""
    return bool(getattr(source, "stateful", False))


def needs_sweeps(part: object) -> bool:
    """Whether a part looks at sweeps at all; one that does not say so does."""
    return bool(getattr(part, "needs_sweeps", True))


def needs_detections(part: object) -> bool:
    """Whether an object source lives on a detector's boxes; one that does not say so does not."""
    return bool(getattr(part, "needs_detections", False))

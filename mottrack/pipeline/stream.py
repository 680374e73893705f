"""The pipeline from sweeps to tracks, frame by frame, as in a vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeVar

from numpy.typing import ArrayLike

from mottrack.core.checks import as_stamp, require_covariance
from mottrack.core.errors import ConfigError, InputError
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
from mottrack.core.timing import clock_s
from mottrack.experiment.experiment import Experiment, load_to_stream
from mottrack.objects.velocity import measure_velocity
from mottrack.pipeline.latency import TOTAL, LatencyLog, LatencyReport, StepTimes, Stopwatch
from mottrack.pipeline.plain_input import Detections, detections_of, pose_of, sweep_of
from mottrack.pipeline.sweep_pairs import PairConfig, SweepPairs
from mottrack.trackers.step_input import LONGEST_STEP_NS

R = TypeVar("R")


class Pair(NamedTuple):
    """Two sweeps that flow is measured between, and those before them."""

    past: tuple[Sweep, ...]
    """At least one, from the oldest to the newest."""
    current: Sweep

    @property
    def previous(self) -> Sweep:
        """The earlier sweep of the two."""
        return self.past[-1]


class Perception(NamedTuple):
    """The parts in front of the tracker."""

    flow: FlowSource
    objects: ObjectSource


@dataclass(frozen=True)
class Step:
    """Results of the pipeline for one frame."""

    pair: Pair | None
    """None where no earlier sweep is recent enough."""
    field: FlowField | None
    """The flow between them; None where it was not needed."""
    objects: Objects | None
    """Input of the tracker, world frame, with velocities; None between key frames."""
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

    def __init__(
        self, experiment: Experiment, *, rate_hz: float = 10.0, parts: Perception | None = None
    ) -> None:
        """Construct every part of the experiment but the data set.

        Args:
            experiment: what to run.
            rate_hz: sweeps a second, whose inverse is the budget of a step.
            parts: its flow and object source, where other runs share them; None: its own.

        Raises:
            MottrackError: a part can't be made, or the rate is not positive.
        """
        settings = experiment.settings
        parts = parts or Perception(make_flow(experiment), experiment.objects.make())
        self.flow, self.objects = parts
        self.watch = Stopwatch()
        self._experiment = experiment
        self._latency = LatencyLog(rate_hz)
        self._velocity = settings.velocity
        self.reset()

    @classmethod
    def from_config(cls, config: str, *overrides: str, rate_hz: float = 10.0) -> Self:
        """Make a pipeline from an experiment file or the name of a shipped one.

        The file's data set is ignored: the caller provides the frames.

        Args:
            config: path of a YAML file, or a name such as ``"demo"``.
            overrides: ``key=value`` texts as on the command line.
            rate_hz: sweeps a second, whose inverse is the budget of a step.

        Raises:
            ConfigError: a key, a name or a value is wrong, or there are several variants.
            DataError: the file can't be read.
        """
        return cls(load_to_stream(config, overrides), rate_hz=rate_hz)

    @property
    def needs_sweeps(self) -> bool:
        """Whether any part reads sweeps."""
        return self.flow.needs_sweeps or self.objects.needs_sweeps

    def reset(self) -> None:
        """Start a new scene: forget all but the latency; loaded and compiled parts stay."""
        settings = self._experiment.settings
        self.tracker: Tracker = self._experiment.tracker.make()
        self._pairs = SweepPairs(
            PairConfig.of(settings, self.flow), required=self.flow.needs_sweeps
        )
        self._stamp_ns: int | None = None
        self._had_sweep = False
        self.flow.reset()
        self.objects.reset()

    def use_ground(self, ground: GroundMap) -> None:
        """Pass a map's heights of the ground to an object source that uses them."""
        if isinstance(self.objects, GroundUser):
            self.objects.use_ground(ground)

    def step(self, frame: Frame, sweep: Sweep | None = None) -> Step:
        """Process the next frame.

        Args:
            frame: later than all before; its detections and truth in the world frame.
            sweep: of the same stamp; None where no part reads sweeps, or none arrived. A lost sweep
                is taken for one without points: nothing is measured, clusters are not found, and
                the tracks go on.

        Raises:
            InputError: the stamp is not later than the last one or a century later, frame and sweep
                have different stamps, or there has been no sweep yet that a part needs: nothing has
                changed then. Or a part refuses its input: this frame is lost, and the pipeline
                continues with the next.
            ConfigError: a part returns something else than its protocol says.
        """
        self._check(frame, sweep)
        if sweep is None and self._had_sweep:
            sweep = Sweep.lost(frame.stamp_ns, frame.world_T_ego)
        self._had_sweep |= sweep is not None and self.needs_sweeps
        self._stamp_ns = frame.stamp_ns
        self.watch.lap()
        start = clock_s()
        if isinstance(self.flow, FrameObserver):
            self.flow.observe(frame)
        pair = None if sweep is None else self._pair(sweep)
        field = self._estimate(pair) if frame.is_key or self.flow.stateful else None
        objects = self._measured_objects(frame, sweep, field) if frame.is_key else None
        tracks = None if objects is None else self._track(frame, objects)
        seconds = self.watch.lap() | {TOTAL: clock_s() - start}
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
        """Process the next frame, given as plain arrays.

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
            InputError: an array is not usable, or as `step`.
            ConfigError: `detections` has an unknown name.
        """
        stamp_ns, pose = as_stamp("stamp_ns", stamp_ns), pose_of(world_T_ego)
        sweep = None if points is None else sweep_of(points, stamp_ns, pose, origin_m)
        found = None if detections is None else detections_of(detections, stamp_ns, pose)
        return self.step(Frame(stamp_ns, pose, found), sweep)

    def finish(self, steps: Sequence[Tracks]) -> list[Tracks]:
        """Return a scene's tracks smoothed over all of it, if the tracker smooths; else as given.

        Raises:
            ConfigError: the tracker does not support what its settings ask for.
        """
        if isinstance(self.tracker, OfflineTracker):
            return self.tracker.finish(list(steps))
        return list(steps)

    def latency(self) -> LatencyReport:
        """Return the latency of the last steps (an hour at 10 Hz) against the time for one."""
        return self._latency.report()

    def step_times(self, period_s: float) -> StepTimes:
        """Return the times behind `latency`, to store; ``period_s`` is that between two sweeps."""
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
        if self._stamp_ns is not None and frame.stamp_ns - self._stamp_ns > LONGEST_STEP_NS:
            expected = f"within a century of the last step, {self._stamp_ns}"
            raise InputError("stamp_ns", frame.stamp_ns, expected)

    def _pair(self, sweep: Sweep) -> Pair | None:
        """Return the sweep with its past; None after a gap or a jump, or without points."""
        if not len(sweep):
            return None
        past = self._pairs.push(sweep)
        if not past and self.flow.stateful:
            self.flow.reset()  # its state lies before a gap: it would refuse every later sweep
        return Pair(past, sweep) if past else None

    def _estimate(self, pair: Pair | None) -> FlowField | None:
        if pair is None:
            return None
        with self.watch("flow"):
            try:
                found = self.flow.estimate(*pair)
            except InputError as error:  # such as a field that refuses its arrays
                field = f"flow source: {error.field}"
                raise InputError(field, error.value, error.expected) from error
            return checked_field(returned(found, FlowField, "flow source"), pair.current)

    def _measured_objects(
        self, frame: Frame, sweep: Sweep | None, field: FlowField | None
    ) -> Objects:
        with self.watch("objects"):
            objects = returned(self.objects.objects(frame, sweep), Objects, "object source")
        with self.watch("velocity"):
            return self._with_velocity(frame, objects, field)

    def _track(self, frame: Frame, objects: Objects) -> Tracks:
        with self.watch("tracker"):
            return returned(self.tracker.step(frame.stamp_ns, objects), Tracks, "tracker")

    def _with_velocity(self, frame: Frame, objects: Objects, field: FlowField | None) -> Objects:
        if field is None or not len(objects):
            return objects
        in_ego = objects.transformed(frame.world_T_ego.inverse(), "ego")
        measured = measure_velocity(field, in_ego, self._velocity, filtered=self.flow.stateful)
        measured = measured.with_error_model(self.flow.error_model)
        measured = measured.rotated(frame.world_T_ego.yaw_rad)
        return objects.with_velocity(joined(objects.velocity, measured))


def joined(given: VelocityMeasurement | None, flow: VelocityMeasurement) -> VelocityMeasurement:
    """Fuse velocities that came with the objects (of a radar, a detector) with those of the flow.

    The error model is one for all rows: the flow's, if any row has a velocity of the flow alone.
    """
    if given is None or not given.valid.any():
        return flow
    if not flow.valid.any():
        return given
    fused = fuse_velocities([given, flow])
    return fused.with_error_model(flow.error_model) if (flow.valid & ~given.valid).any() else fused


def returned(value: object, kind: type[R], part: str) -> R:
    """Return what a part has returned, if it is what the part's protocol says.

    Raises:
        ConfigError: it is something else, as of a plug-in that forgets to return.
    """
    if not isinstance(value, kind):
        found, wanted = type(value).__name__, kind.__name__
        raise ConfigError(f"the {part} returned {found}, expected {wanted}")
    return value


def checked_field(field: FlowField, current: Sweep) -> FlowField:
    """Return a field if it is of the current sweep and its covariances are such.

    Raises:
        InputError: it has another stamp, or a measured cell's covariance is not symmetric or not
            positive semi-definite.
    """
    if field.stamp_ns != current.stamp_ns:
        expected = f"that of the current sweep, {current.stamp_ns}"
        raise InputError("flow source: stamp_ns of the field", field.stamp_ns, expected)
    measured = field.covariance_m2ps2[field.valid]
    require_covariance("flow source: covariance_m2ps2 of measured cells", measured)
    return field


def make_flow(experiment: Experiment) -> FlowSource:
    """Construct the flow source of an experiment, with the experiment's grid.

    Raises:
        MottrackError: it can't be made.
    """
    source: FlowSource = experiment.flow.make(grid=experiment.settings.grid.grid())
    return source

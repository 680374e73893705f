"""The chain from a sweep to tracks, fed one frame after the other, as a vehicle would."""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver, ObjectSource, Tracker
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects, Tracks
from mottrack.core.sweep import Sweep
from mottrack.objects.velocity import measure_velocity
from mottrack.pipeline.experiment import Experiment
from mottrack.pipeline.stopwatch import Stopwatch
from mottrack.pipeline.sweep_pairs import SweepPairs


@dataclass(frozen=True)
class Step:
    """What the pipeline made of one frame."""

    pair: tuple[Sweep, Sweep] | None
    """The earlier sweep and the current one; None where there is no earlier one near enough."""
    field: FlowField | None
    """The flow between them; None where it was not asked for."""
    tracks: Tracks | None
    """World frame; None between key frames."""


class Pipeline:
    """Flow, objects, their velocities and the tracker of one scene.

    Example:
        pipeline = Pipeline(load_experiments("demo", ["flow=icp"])[0])
        for frame, sweep in drive:
            step = pipeline.step(frame, sweep)
    """

    def __init__(self, experiment: Experiment) -> None:
        """Makes every part of the experiment but the data set; a new scene needs a new pipeline."""
        settings = experiment.settings
        self.flow: FlowSource = experiment.flow.make(grid=settings.grid.grid())
        self.objects: ObjectSource = experiment.objects.make()
        self.tracker: Tracker = experiment.tracker.make()
        self.watch = Stopwatch()
        self._velocity = settings.velocity
        self._pairs = SweepPairs(settings.pair_s, settings.max_pair_s)
        self._stateful = is_stateful(self.flow)
        self.flow.reset()
        self.objects.reset()

    @property
    def needs_sweeps(self) -> bool:
        """Whether any part looks at sweeps."""
        return needs_sweeps(self.flow) or needs_sweeps(self.objects)

    def step(self, frame: Frame, sweep: Sweep | None = None) -> Step:
        """Takes in the next frame.

        Args:
            frame: later than all before; its detections and truth in the world frame.
            sweep: of the same stamp; None where no part looks at sweeps.

        Raises:
            InputError: the stamps differ, or a part refuses its input.
        """
        if sweep is not None and sweep.stamp_ns != frame.stamp_ns:
            raise InputError(
                "stamp_ns of sweep", sweep.stamp_ns, f"that of the frame, {frame.stamp_ns}"
            )
        if isinstance(self.flow, FrameObserver):
            self.flow.observe(frame)
        pair = None if sweep is None else self._pair(sweep)
        field = self._estimate(pair) if frame.is_key or self._stateful else None
        tracks = self._track(frame, sweep, field) if frame.is_key else None
        return Step(pair, field, tracks)

    def _pair(self, sweep: Sweep) -> tuple[Sweep, Sweep] | None:
        previous = self._pairs.push(sweep, consecutive=self._stateful)
        return None if previous is None else (previous, sweep)

    def _estimate(self, pair: tuple[Sweep, Sweep] | None) -> FlowField | None:
        if pair is None:
            return None
        with self.watch("flow"):
            return self.flow.estimate(*pair)

    def _track(self, frame: Frame, sweep: Sweep | None, field: FlowField | None) -> Tracks:
        with self.watch("objects"):
            objects = self.objects.objects(frame, sweep)
        with self.watch("velocity"):
            objects = self._with_velocity(frame, objects, field)
        with self.watch("tracker"):
            return self.tracker.step(frame.stamp_ns, objects)

    def _with_velocity(self, frame: Frame, objects: Objects, field: FlowField | None) -> Objects:
        if field is None or not len(objects):
            return objects
        in_ego = objects.transformed(frame.world_T_ego.inverse(), "ego")
        measured = measure_velocity(field, in_ego, self._velocity)
        return objects.with_velocity(measured.rotated(frame.world_T_ego.yaw_rad))


def is_stateful(source: object) -> bool:
    """Whether a flow source must see every sweep (DOGMa), not only the key frames'."""
    return bool(getattr(source, "stateful", False))


def needs_sweeps(part: object) -> bool:
    """Whether a part looks at sweeps at all; one that does not say so does."""
    return bool(getattr(part, "needs_sweeps", True))

"""The main loop: from sweeps and detections of one scene to its tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver, ObjectSource, Scene, Tracker
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects, Tracks
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import Sweep
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable
from mottrack.objects.velocity import VelocityConfig, measure_velocity
from mottrack.pipeline.album import Album
from mottrack.pipeline.experiment import Experiment
from mottrack.pipeline.flow_judge import FlowJudge
from mottrack.pipeline.stopwatch import Stopwatch
from mottrack.pipeline.sweep_pairs import SweepPairs

OnFrame = Callable[[int, int], None]


@dataclass
class Stages:
    """The parts of one scene's run: made new for it, thrown away after it."""

    flow: FlowSource
    objects: ObjectSource
    tracker: Tracker
    pairs: SweepPairs
    velocity: VelocityConfig
    watch: Stopwatch

    @classmethod
    def of(cls, experiment: Experiment) -> Stages:
        """Makes every part of the experiment but the data set."""
        settings = experiment.settings
        flow = experiment.flow.make(grid=settings.grid.grid())
        flow.reset()
        objects = experiment.objects.make()
        objects.reset()
        pairs = SweepPairs(settings.pair_s, settings.max_pair_s)
        tracker = experiment.tracker.make()
        return cls(flow, objects, tracker, pairs, settings.velocity, Stopwatch())

    def read(self, scene: Scene, index: int) -> tuple[Sweep, tuple[Sweep, Sweep] | None]:
        """The sweep of a frame, and the pair of it with the earlier one it is compared with."""
        with self.watch("read"):
            sweep = scene.sweep(index)
        previous = self.pairs.push(sweep, consecutive=is_stateful(self.flow))
        return sweep, None if previous is None else (previous, sweep)

    def estimate(self, frame: Frame, pair: tuple[Sweep, Sweep] | None) -> FlowField | None:
        """The flow at this frame; None where no earlier sweep is near enough in time."""
        if isinstance(self.flow, FrameObserver):
            self.flow.observe(frame)
        if pair is None or not (frame.is_key or is_stateful(self.flow)):
            return None
        with self.watch("flow"):
            return self.flow.estimate(*pair)

    def track(self, frame: Frame, sweep: Sweep | None, field: FlowField | None) -> Tracks:
        """Objects of this frame, their velocities, and the tracks that follow from them."""
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
        measured = measure_velocity(field, in_ego, self.velocity)
        return objects.with_velocity(measured.rotated(frame.world_T_ego.yaw_rad))


def is_stateful(source: object) -> bool:
    """Whether a flow source must see every sweep (DOGMa), not only the key frames'."""
    return bool(getattr(source, "stateful", False))


def needs_sweeps(part: object) -> bool:
    """Whether a part looks at sweeps at all; one that does not say so does."""
    return bool(getattr(part, "needs_sweeps", True))


@dataclass(frozen=True)
class SceneRun:
    """What running a scene leaves behind."""

    result: SceneResult
    snapshots: list[Snapshot]


def run_scene(
    experiment: Experiment, scene: Scene, on_frame: OnFrame = lambda done, total: None
) -> SceneRun:
    """Runs one scene from first frame to last.

    Args:
        experiment: what to run.
        scene: the scene, opened.
        on_frame: is told after each frame how many are done, of how many.

    Raises:
        MottrackError: the data are damaged, or a part refuses its input.
    """
    stages = Stages.of(experiment)
    judge = FlowJudge.of(experiment.settings, has_sweeps=scene.has_sweeps)
    album = Album.of(experiment.settings.snapshots, len(scene))
    reads = judge.enabled or needs_sweeps(stages.flow) or needs_sweeps(stages.objects)
    frames: list[Frame] = []
    steps: list[Tracks] = []
    for index in range(len(scene)):
        with stages.watch("read"):
            frame = scene.frame(index)
        judge.observe(frame)
        sweep, pair = stages.read(scene, index) if reads else (None, None)
        field = stages.estimate(frame, pair)
        if frame.is_key:
            if field is not None and pair is not None:
                judge.judge(frame, field, pair, len(frames))
            album.take(index, len(frames), sweep, field)
            steps.append(stages.track(frame, sweep, field))
            frames.append(frame)
            stages.watch.next_frame()
        on_frame(index + 1, len(scene))
    result = _result(scene.name, frames, steps, judge.samples(), stages.watch)
    return SceneRun(result, album.snapshots)


def _result(
    name: str, frames: list[Frame], steps: list[Tracks], flow: FlowSamples, watch: Stopwatch
) -> SceneResult:
    hulls = [corners for step in steps for corners in step.hull or ()]
    return SceneResult(
        name=name,
        frames=FrameTable.of(frames),
        truth=TruthTable.of(frames),
        tracks=TrackTable.of(steps),
        flow=flow,
        hull_xy_m=np.concatenate(hulls) if hulls else np.zeros((0, 2)),
        timings_s=watch.seconds(),
    )

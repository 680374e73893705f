"""The main loop over the frames of one scene, for one run or for several that share its sweeps."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self, TypeVar

import numpy as np

from mottrack.core.concerns import Concern
from mottrack.core.errors import DataError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import DetectedScene, FlowSource, GroundMap, Scene, VelocityJudge
from mottrack.core.objects import Tracks
from mottrack.core.result import SceneResult
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import median_period_s
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable
from mottrack.datasets.plausibility.watch import SceneWatch
from mottrack.eval.label_free import LabelFreeSums
from mottrack.eval.sceneflow.sums import SceneFlowSums
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.flow_sampler import FlowSampler
from mottrack.pipeline.label_free_sampler import (
    Evidences,
    LabelFreeSampler,
    stating_innovations,
    stride_of,
)
from mottrack.pipeline.latency import StepTimes
from mottrack.pipeline.measured_flow import MeasuredFlow
from mottrack.pipeline.once import SharedFlow, SharedFrames, SharedObjects
from mottrack.pipeline.scene_flow_sampler import SceneFlowSampler, SharedTruth
from mottrack.pipeline.snapshots import SnapshotRecorder
from mottrack.pipeline.stream import Perception, Pipeline, make_flow

OnFrame = Callable[[int, int], None]
"""Called after each frame with the number of frames that are done, and of all."""
MakeFlow = Callable[[Experiment], FlowSource]
R = TypeVar("R")
DEFAULT_PERIOD_S = 0.1
"""Latency budget of a scene of one frame: the period of a 10 Hz LiDAR."""


@dataclass(frozen=True)
class SceneRun:
    """Results of running a scene."""

    result: SceneResult
    snapshots: list[Snapshot]
    times: StepTimes
    """Of every step; the period is the median time between two frames of the scene."""
    objects: tuple[SceneObjects, ...] = ()
    """What the tracker received, of each key frame."""
    scene_flow: SceneFlowSums | None = None
    """Point by point; None where flow is not compared with truth."""
    label_free: LabelFreeSums | None = None
    """Without labels; None where no field was judged."""


@dataclass(frozen=True)
class Member:
    """One run among those that go through a scene together."""

    experiment: Experiment
    keep_snapshots: bool = True
    """Whether the key frames are kept for pictures."""


def run_scene(
    experiment: Experiment,
    scene: Scene,
    on_frame: OnFrame | None = None,
    *,
    keep_snapshots: bool = True,
) -> SceneRun:
    """Run one scene.

    Args:
        experiment: what to run.
        scene: the scene, opened.
        on_frame: receives the progress after each frame.
        keep_snapshots: whether the key frames are kept for pictures.

    Raises:
        MottrackError: the data are damaged, or a part refuses its input.
    """
    (run,) = run_together([Member(experiment, keep_snapshots)], scene, on_frame)
    if isinstance(run, Exception):
        raise run
    return run


def run_together(
    members: Sequence[Member],
    scene: Scene,
    on_frame: OnFrame | None = None,
    make_flow: MakeFlow = make_flow,
) -> list[SceneRun | Exception]:
    """Run one scene for several experiments in lockstep, frame by frame.

    Each sweep is read once, each flow and each object source that several have in common computes
    once. The results are those of each run alone; so are the times, which each run is charged with.

    Args:
        members: on the same data set.
        scene: the scene, opened.
        on_frame: receives the progress after each frame.
        make_flow: constructs the flow source of an experiment.

    Returns:
        Per member its results, or the error that ended it: the others continue.
    """
    shared = SharedParts(scene, make_flow)
    loops: list[SceneLoop | Exception] = [
        _attempt(SceneLoop, member, scene, shared) for member in members
    ]
    for index in range(len(scene)):
        loops = [_attempt(x.step, index) if isinstance(x, SceneLoop) else x for x in loops]
        if all(isinstance(loop, Exception) for loop in loops):
            break
        if on_frame is not None:
            on_frame(index + 1, len(scene))
    return [_attempt(loop.finish) if isinstance(loop, SceneLoop) else loop for loop in loops]


def _attempt(function: Callable[..., R], *arguments: object) -> R | Exception:
    """Return the function's value, or its error: only this run fails, whatever the error."""
    try:
        return function(*arguments)
    except Exception as error:  # noqa: BLE001
        return error


class SharedParts:
    """What the runs of one scene share: its frames, and parts of equal settings."""

    def __init__(self, scene: Scene, make_flow: MakeFlow) -> None:
        self.frames, self.truth = SharedFrames(scene), SharedTruth(scene)
        self.evidences = Evidences()
        self._make_flow, self._has_sweeps = make_flow, scene.has_sweeps
        self._flows: dict[str, SharedFlow] = {}
        self._objects: dict[tuple[str, bool], SharedObjects] = {}

    def of(self, experiment: Experiment) -> Perception:
        """Return the flow and the object source of an experiment, made where first asked for.

        Raises:
            MottrackError: one can't be made.
        """
        key = flow_identity(experiment)
        if key not in self._flows:
            self._flows[key] = SharedFlow(self._make_flow(experiment))
        flow, source = self._flows[key], experiment.objects.make()
        sampled = experiment.settings.score_flow and self._has_sweeps
        # a run that reads no sweeps calls the source with other arguments: it has one of its own
        reads = sampled or flow.needs_sweeps or source.needs_sweeps
        objects_key = (as_text(experiment.objects.resolved()), reads)
        return Perception(flow, self._objects.setdefault(objects_key, SharedObjects(source)))


class SceneLoop:
    """One run on its way through a scene."""

    def __init__(self, member: Member, scene: Scene, shared: SharedParts) -> None:
        """Start a scene.

        Raises:
            MottrackError: a part can't be made.
        """
        experiment, settings = member.experiment, member.experiment.settings
        self._scene, self._frames = scene, shared.frames
        diagnosed = replace(experiment, tracker=stating_innovations(experiment))
        self._pipeline = Pipeline(diagnosed, parts=shared.of(experiment))
        self._flow = experiment.flow.kind
        if isinstance(scene, GroundMap):
            self._pipeline.use_ground(scene)
        self._sampler = FlowSampler.of(settings, scene.classes, has_sweeps=scene.has_sweeps)
        self._scene_flow = SceneFlowSampler(shared.truth, self._sampler.enabled)
        self._recorder = SnapshotRecorder(settings.snapshots.points, enabled=member.keep_snapshots)
        self._reads_sweeps = self._sampler.enabled or self._pipeline.needs_sweeps
        self._label_free = LabelFreeSampler(
            shared.evidences,
            partial(make_flow, experiment),
            settings.label_free if self._reads_sweeps else "never",
            stride_of(len(scene)),
        )
        self._watch, self._measured = SceneWatch(scene), MeasuredFlow()
        self._keys: list[Frame] = []
        self._steps: list[Tracks] = []
        self._objects: list[SceneObjects] = []
        self._stamps_ns: list[int] = []

    def step(self, index: int) -> Self:
        """Process the next frame.

        Raises:
            MottrackError: the data are damaged, or a part refuses its input.
        """
        pipeline, row = self._pipeline, len(self._keys)
        with pipeline.watch("read"):
            frame = self._frames.frame(index)
            sweep = self._frames.sweep(index) if self._reads_sweeps else None
        self._stamps_ns.append(frame.stamp_ns)
        _check_detections(pipeline, self._scene, frame)
        self._sampler.observe(frame)
        self._watch.add_unseen(frame, sweep)
        step = pipeline.step(frame, sweep)
        self._scene_flow.collect(frame, sweep, step.field)
        if pipeline.flow.needs_sweeps:
            self._measured.add(step)
        self._label_free.collect(frame, step, index)
        if step.tracks is not None:
            self._label_free.innovations(frame, pipeline.tracker)
            if step.objects is not None:
                self._objects.append(SceneObjects.at(row, step.objects))
            self._sampler.collect(frame, step, row)
            self._recorder.take(row, sweep, step.field, step.objects)
            self._steps.append(step.tracks)
            self._keys.append(frame)
            pipeline.watch.next_frame()
        return self

    def finish(self) -> SceneRun:
        """Return the results after the last frame.

        Raises:
            ConfigError: the tracker does not support what its settings ask for.
        """
        steps, samples = self._pipeline.finish(self._steps), self._sampler.samples()
        result = _result(self._scene, self._keys, steps, samples)
        concerns = (*self._watch.concerns(), *self._measured.concerns(), *self._doubts())
        result = replace(result, timings_s=self._pipeline.watch.seconds(), concerns=concerns)
        period_s = median_period_s(self._stamps_ns, DEFAULT_PERIOD_S)
        return SceneRun(
            result,
            self._recorder.snapshots,
            self._pipeline.step_times(period_s),
            tuple(self._objects),
            self._scene_flow.sums(),
            self._label_free.sums(),
        )

    def _doubts(self) -> list[Concern]:
        """Return the tracker's concern about the flow source's velocities, with its name."""
        tracker = self._pipeline.tracker
        doubt = tracker.velocity_concern() if isinstance(tracker, VelocityJudge) else None
        return [] if doubt is None else [replace(doubt, kind=f"{self._flow} flow: {doubt.kind}")]


def flow_identity(experiment: Experiment) -> str:
    """Return the settings that decide a flow field, as text: runs of equal ones share it."""
    settings = experiment.settings
    chosen = settings.model_dump(mode="json", include={"grid", "pair_s", "max_pair_s", "history_s"})
    return as_text({"flow": experiment.flow.resolved(), **chosen})


def as_text(settings: Mapping[str, Any]) -> str:
    """Return settings as text: the same for the same values."""
    return json.dumps(settings, sort_keys=True, default=str)


def _check_detections(pipeline: Pipeline, scene: Scene, frame: Frame) -> None:
    """Refuse a key frame without required detections, naming the file that should hold them."""
    absent = frame.is_key and frame.detections is None and pipeline.objects.needs_detections
    if absent and isinstance(scene, DetectedScene):
        expected = "a detector's boxes (dataset.detections=...), or objects=clusters"
        raise DataError(scene.detections_at, f"detections of {scene.name}", "absent", expected)


def _result(
    scene: Scene, frames: list[Frame], steps: list[Tracks], flow: FlowSamples
) -> SceneResult:
    hulls = [corners for step in steps for corners in step.hull or ()]
    return SceneResult(
        name=scene.name,
        frames=FrameTable.of(frames),
        truth=TruthTable.of(frames),
        tracks=TrackTable.of(steps),
        flow=flow,
        hull_xy_m=np.concatenate(hulls) if hulls else np.zeros((0, 2)),
        classes=tuple(scene.classes),
    )

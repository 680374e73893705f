"""The main loop: one scene from its first frame to its last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.errors import DataError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import DetectedScene, GroundMap, Scene
from mottrack.core.objects import Tracks
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.flow_sampler import FlowSampler
from mottrack.pipeline.latency import StepTimes
from mottrack.pipeline.snapshots import NullRecorder, SnapshotRecorder
from mottrack.pipeline.stream import Pipeline, needs_detections

OnFrame = Callable[[int, int], None]


@dataclass(frozen=True)
class SceneRun:
    """What running a scene leaves behind."""

    result: SceneResult
    snapshots: list[Snapshot]
    times: StepTimes
    """Of every step, against the time between two frames of the scene."""


def run_scene(
    experiment: Experiment,
    scene: Scene,
    on_frame: OnFrame = lambda done, total: None,
    *,
    keep_snapshots: bool = True,
) -> SceneRun:
    """Runs one scene.

    Args:
        experiment: what to run.
        scene: the scene, opened.
        on_frame: is told after each frame how many are done, of how many.
        keep_snapshots: whether every key frame is kept to be drawn.

    Raises:
        MottrackError: the data are damaged, or a part refuses its input.
    """
    pipeline = Pipeline(experiment)
    if isinstance(scene, GroundMap):
        pipeline.use_ground(scene)
    judge = FlowSampler.of(experiment.settings, has_sweeps=scene.has_sweeps)
    album = (SnapshotRecorder if keep_snapshots else NullRecorder)(
        experiment.settings.snapshots.points
    )
    reads_sweeps = judge.enabled or pipeline.needs_sweeps
    frames: list[Frame] = []
    steps: list[Tracks] = []
    stamps_ns: list[int] = []
    for index in range(len(scene)):
        with pipeline.watch("read"):
            frame = scene.frame(index)
            sweep = scene.sweep(index) if reads_sweeps else None
        stamps_ns.append(frame.stamp_ns)
        _check_detections(pipeline, scene, frame)
        judge.observe(frame)
        step = pipeline.step(frame, sweep)
        if step.tracks is not None:
            judge.judge(frame, step, len(frames))
            album.take(len(frames), sweep, step.field, step.objects)
            steps.append(step.tracks)
            frames.append(frame)
            pipeline.watch.next_frame()
        on_frame(index + 1, len(scene))
    result = _result(scene, frames, pipeline.finish(steps), judge.samples())
    result = replace(result, timings_s=pipeline.watch.seconds())
    return SceneRun(result, album.snapshots, pipeline.step_times(_period_s(stamps_ns)))


def _check_detections(pipeline: Pipeline, scene: Scene, frame: Frame) -> None:
    """Names the place where the detections were looked for, which the frame does not know."""
    absent = frame.is_key and frame.detections is None and needs_detections(pipeline.objects)
    if absent and isinstance(scene, DetectedScene):
        expected = "a detector's boxes (dataset.detections=...), or objects=clusters"
        raise DataError(scene.detections_at, f"detections of {scene.name}", "absent", expected)


def _period_s(stamps_ns: list[int]) -> float:
    """Median time between two frames; that of 10 Hz where there is only one."""
    return float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else 0.1


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

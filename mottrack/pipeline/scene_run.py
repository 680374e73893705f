"""The main loop over the frames of one scene."""

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
from mottrack.core.sweep import median_period_s
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.flow_sampler import FlowSampler
from mottrack.pipeline.latency import StepTimes
from mottrack.pipeline.snapshots import SnapshotRecorder
from mottrack.pipeline.stream import Pipeline

OnFrame = Callable[[int, int], None]
"""Called after each frame with the number of frames that are done, and of all."""
DEFAULT_PERIOD_S = 0.1
"""Latency budget of a scene of one frame: the period of a 10 Hz LiDAR."""


@dataclass(frozen=True)
class SceneRun:
    """Results of running a scene."""

    result: SceneResult
    snapshots: list[Snapshot]
    times: StepTimes
    """Of every step; the period is the median time between two frames of the scene."""


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
    pipeline = Pipeline(experiment)
    if isinstance(scene, GroundMap):
        pipeline.use_ground(scene)
    sampler = FlowSampler.of(experiment.settings, has_sweeps=scene.has_sweeps)
    recorder = SnapshotRecorder(experiment.settings.snapshots.points, enabled=keep_snapshots)
    reads_sweeps = sampler.enabled or pipeline.needs_sweeps
    frames: list[Frame] = []
    steps: list[Tracks] = []
    stamps_ns: list[int] = []
    for index in range(len(scene)):
        with pipeline.watch("read"):
            frame = scene.frame(index)
            sweep = scene.sweep(index) if reads_sweeps else None
        stamps_ns.append(frame.stamp_ns)
        _check_detections(pipeline, scene, frame)
        sampler.observe(frame)
        step = pipeline.step(frame, sweep)
        if step.tracks is not None:
            sampler.collect(frame, step, len(frames))
            recorder.take(len(frames), sweep, step.field, step.objects)
            steps.append(step.tracks)
            frames.append(frame)
            pipeline.watch.next_frame()
        if on_frame is not None:
            on_frame(index + 1, len(scene))
    result = _result(scene, frames, pipeline.finish(steps), sampler.samples())
    result = replace(result, timings_s=pipeline.watch.seconds())
    times = pipeline.step_times(median_period_s(stamps_ns, DEFAULT_PERIOD_S))
    return SceneRun(result, recorder.snapshots, times)


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

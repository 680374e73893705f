"""What a tracker receives in each scene, computed once, and trackers run on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mottrack.core.frame import Frame
from mottrack.core.interfaces import OfflineTracker, Scene
from mottrack.core.objects import Objects, Tracks, Truth
from mottrack.core.result import SceneResult
from mottrack.core.tables import FlowSamples, FrameTable, TrackTable, TruthTable
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part
from mottrack.pipeline.stream import Pipeline
from mottrack.runs.runner import scene_names

OnScene = Callable[[str, int, int], None]


class TruthFrame(NamedTuple):
    """Input of the tracker at a key frame, with its truth."""

    objects: Objects
    truth: Truth


@dataclass(frozen=True)
class RecordedScene:
    """The objects of every key frame of a scene, with the truth that scores the tracks."""

    result: SceneResult
    """Without tracks."""
    objects: tuple[Objects, ...]
    """Per key frame; world frame, with measured velocities if there is a flow source."""

    def truth_frames(self) -> Iterator[TruthFrame]:
        """Yield what the tracker receives at each annotated key frame, with the truth."""
        table = self.result.truth
        names = [name for name in TruthTable.COLUMNS if name != "frame"]
        for k, objects in enumerate(self.objects):
            if self.result.frames.annotated[k]:
                rows = table.select(np.flatnonzero(table.frame == k))
                columns = {name: getattr(rows, name) for name in names}
                yield TruthFrame(objects, Truth(stamp_ns=objects.stamp_ns, **columns))

    def tracked(self, tracker: Part) -> SceneResult:
        """Return the result of a new tracker over the scene."""
        one = tracker.make()
        steps = [one.step(objects.stamp_ns, objects) for objects in self.objects]
        steps = one.finish(steps) if isinstance(one, OfflineTracker) else steps
        hulls = [corners for step in steps for corners in step.hull or ()]
        hull_xy_m = np.concatenate(hulls) if hulls else np.zeros((0, 2))
        return replace(self.result, tracks=TrackTable.of(steps), hull_xy_m=hull_xy_m)


@dataclass
class _Recorder:
    """Takes the tracker's place in the pipeline and keeps what it receives."""

    objects: list[Objects] = field(default_factory=list)

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Keep the objects; return no tracks."""
        self.objects.append(objects)
        return Tracks.empty(stamp_ns)


def record(experiment: Experiment, on_scene: OnScene = lambda *_: None) -> list[RecordedScene]:
    """Run the experiment up to its tracker over all its scenes.

    Args:
        experiment: its tracker is left out.
        on_scene: is called with (name, done, total) after each scene.

    Raises:
        MottrackError: the data are damaged or absent.
    """
    dataset, names = experiment.dataset.make(), scene_names(experiment)
    recorded = []
    for k, name in enumerate(names):
        recorded.append(_recorded(experiment, dataset.scene(name)))
        on_scene(name, k + 1, len(names))
    return recorded


def _recorded(experiment: Experiment, scene: Scene) -> RecordedScene:
    pipeline, recorder = Pipeline(experiment), _Recorder()
    pipeline.tracker = recorder
    keys: list[Frame] = []
    for index in range(len(scene)):
        frame = scene.frame(index)
        step = pipeline.step(frame, scene.sweep(index) if pipeline.needs_sweeps else None)
        if step.tracks is not None:
            keys.append(frame)
    result = SceneResult(
        name=scene.name,
        frames=FrameTable.of(keys),
        truth=TruthTable.of(keys),
        tracks=TrackTable.of([Tracks.empty(frame.stamp_ns) for frame in keys]),
        flow=FlowSamples.stacked([]),
        classes=tuple(scene.classes),
    )
    return RecordedScene(result, tuple(recorder.objects))


def tracked(scenes: Sequence[RecordedScene], tracker: Part) -> list[SceneResult]:
    """Return the results of a tracker over scenes, each with a new one."""
    return [scene.tracked(tracker) for scene in scenes]

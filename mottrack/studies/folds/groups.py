"""The scenes of a group, recorded once; tracks of a tracker on them, and stored ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mottrack.core.errors import ConfigError, DataError
from mottrack.core.result import SceneResult
from mottrack.datasets.kitti.boxes import image_boxes
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.kitti.dataset import KittiScene
from mottrack.datasets.kitti.results import frame_numbers, in_camera, seen_tracks
from mottrack.datasets.nuscenes.tracking_file import TrackingFile
from mottrack.eval.kitti.boxes import KittiBoxes, read_boxes
from mottrack.eval.kitti.concerns import Files
from mottrack.eval.scores import ScoreConfig
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part
from mottrack.studies.folds.judges import Judge, KittiJudge, NuScenesJudge, files_of
from mottrack.studies.folds.plan import Group
from mottrack.studies.tuning.recorded import RecordedScene, record

OnScene = Callable[[str], None]


@dataclass(frozen=True)
class RecordedGroup:
    """A group with what the tracker receives in each of its scenes."""

    group: Group
    scenes: Mapping[str, RecordedScene]
    scoring: ScoreConfig
    cameras: Mapping[str, Camera]
    """Of KITTI's sequences; empty by other rules."""
    labels: Mapping[str, KittiBoxes]
    """Likewise."""

    @property
    def names(self) -> list[str]:
        """The scenes in order."""
        return list(self.scenes)

    def judge(self, results: Sequence[SceneResult]) -> Judge:
        """Return a judge of the tracks in a result for each scene, in order."""
        if self.group.rules == "nuscenes":
            return NuScenesJudge(dict(zip(self.names, results, strict=True)), self.scoring)
        files = {
            result.name: files_of(
                self.labels[result.name], kitti_boxes(result, self.cameras[result.name])
            )
            for result in results
        }
        return KittiJudge(files)

    def tracked(self, tracker: Part) -> list[SceneResult]:
        """Return the results of a tracker, a new one for each scene."""
        return [scene.tracked(tracker) for scene in self.scenes.values()]

    def stored(self, name: str, data: Path) -> Judge:
        """Return a judge of another tracker's stored output.

        Raises:
            DataError: a file is missing or damaged, or has nothing of a scene.
        """
        paths = self.group.stored(name, data)
        if self.group.rules == "kitti":
            return KittiJudge({scene: self._stored_files(scene, paths) for scene in self.names})
        files = [TrackingFile(path) for path in paths]
        return self.judge([_submitted(one.result, files) for one in self.scenes.values()])

    def _stored_files(self, scene: str, folders: Sequence[Path]) -> Files:
        parts = [read_boxes(folder / f"{scene}.txt") for folder in folders]
        names = KittiBoxes.__dataclass_fields__
        joined = KittiBoxes(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))
        return files_of(self.labels[scene], joined)


def record_group(group: Group, data: Path, on_scene: OnScene) -> RecordedGroup:
    """Run the experiment of every scene of a group up to its tracker.

    Raises:
        ConfigError: a setting is wrong, or kitti's rules are asked for of another data set.
        DataError: the data are damaged or absent.
    """
    experiments = group.experiments(data)
    scenes, cameras, labels = {}, {}, {}
    for name, experiment in experiments.items():
        try:
            (scenes[name],) = record(experiment)
        except ConfigError as error:
            raise ConfigError(f"group {group.name}: {error}") from error
        if group.rules == "kitti":
            cameras[name] = _camera(group, experiment, name)
            labels[name] = read_boxes(_labels(experiment, name))
        on_scene(f"{group.name}: {name}")
    scoring = next(iter(experiments.values())).settings.scores
    return RecordedGroup(group, scenes, scoring, cameras, labels)


def _camera(group: Group, experiment: Experiment, name: str) -> Camera:
    scene = experiment.dataset.make().scene(name)
    if not isinstance(scene, KittiScene):
        raise ConfigError(f"group {group.name}: rules kitti need the data set kitti")
    return scene.camera


def _labels(experiment: Experiment, name: str) -> Path:
    settings = experiment.dataset.resolved()
    return Path(str(settings["root"])) / str(settings["split"]) / "label_02" / f"{name}.txt"


def _submitted(scene: SceneResult, files: Sequence[TrackingFile]) -> SceneResult:
    for file in files:
        found = file.tracks(scene.frames.token.tolist())
        if found is not None:
            return replace(scene, tracks=found.table(), hull_xy_m=np.zeros((0, 2)))
    raise DataError(files[0].path, "results", f"nothing of {scene.name}", "tracks of every scene")


def kitti_boxes(result: SceneResult, camera: Camera) -> KittiBoxes:
    """Return the tracks that the camera sees, as reading them back from a KITTI file would."""
    tracks = seen_tracks(result, camera)
    boxes = in_camera(tracks, result, camera)
    x, y, z = boxes.bottom_m.T
    height, width, length = boxes.size_hwl_m.T
    nothing = np.zeros(len(tracks))
    return KittiBoxes(
        frame=frame_numbers(result)[tracks.frame],
        id=tracks.id,
        kind=tracks.label,
        truncation=nothing,
        occlusion=nothing,
        image_box=image_boxes(boxes, camera.projection, camera.size),
        box=np.stack([x, z, -y + height / 2, length, width, height, -boxes.ry_rad], axis=1),
        score=tracks.score,
    )

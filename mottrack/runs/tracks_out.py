"""Tracks of a stored run in the formats of other tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.errors import ConfigError, unknown_name
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable
from mottrack.datasets.argoverse2 import results as argoverse2
from mottrack.datasets.kitti import results as kitti
from mottrack.datasets.kitti.boxes import image_boxes
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.mot.plane import PlaneBoxes, to_image
from mottrack.datasets.nuscenes.submission import write_submission
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.stored import stored_experiment
from mottrack.formats.box_table import track_rows, write_box_rows
from mottrack.formats.mot_rows import NO_BOX, MotResults, write_mot_results
from mottrack.formats.nuscenes_splits import best_split
from mottrack.runs.run_folder import RunFolder, stored_scenes


@dataclass(frozen=True)
class StoredTracks:
    """The tracks of a run, and the data set that they were made on.

    folder: of the run.
    root: where the data set lies now; None: where the run found it.
    """

    folder: RunFolder
    experiment: Experiment
    root: Path | None = None

    @classmethod
    def of(cls, run: Path, root: Path | None = None) -> StoredTracks:
        """Open a stored run.

        Raises:
            ConfigError: the folder holds several runs.
            ResultError: it holds none, or none of its scenes is finished.
        """
        stored_scenes(run)
        folder = RunFolder(run)
        experiment = stored_experiment(folder.config_file, folder.stored_hash, "")
        return cls(folder, experiment, root)

    @cached_property
    def results(self) -> list[SceneResult]:
        """Results of all finished scenes, in order of their name."""
        return [self.folder.load(scene) for scene in self.folder.scenes]

    @property
    def kind(self) -> str:
        """Kind of the data set."""
        return self.experiment.dataset.kind

    def camera(self, scene: str) -> Camera:
        """Return the camera of a KITTI sequence; KITTI's nominal one for other data sets.

        Raises:
            ConfigError: the run was on KITTI, and its data set does not say where it lay.
            DataError: the calibration is missing or damaged.
        """
        if self.kind != "kitti":
            return Camera.nominal()
        settings = self.settings
        root = self.root or Path(str(settings.get("root")))
        path = root / str(settings.get("split", "training")) / "calib" / f"{scene}.txt"
        if not path.exists():
            raise ConfigError(f"{path} is missing: name the data set with --root")
        return Camera.of_file(path)

    @property
    def split(self) -> str:
        """The nuScenes split that the run was over: its setting, else the smallest that holds it.

        Raises:
            ConfigError: the run was on another data set, or its scenes are of no one split.
        """
        configured = self.settings.get("split")
        if self.kind == "nuscenes" and isinstance(configured, str):
            return configured
        found = best_split(self.folder.scenes)
        if found is None:
            first = self.folder.scenes[0]
            raise ConfigError(
                f"{self.folder.path} is a run on {self.kind} with scenes ({first}, ...) of no one "
                "nuScenes split; name it with --split"
            )
        return found

    @property
    def settings(self) -> Mapping[str, object]:
        """Settings of the data set, as the run stored them."""
        config = self.experiment.dataset.config
        return config if isinstance(config, dict) else config.model_dump(mode="json")


class Written(NamedTuple):
    """What has been written."""

    files: int
    boxes: int


Writer = Callable[[StoredTracks, Path], Written]


def write_tracks(tracks: StoredTracks, format_name: str, out: Path) -> Written:
    """Write the tracks of a run.

    Args:
        tracks: the run.
        format_name: one of `WRITERS`.
        out: a file for nuscenes, csv and parquet, else a folder.

    Raises:
        ConfigError: the format is unknown, or the run is not of a kind that it can hold.
        MottrackError: a stored result or a file of the data set is missing or damaged.
    """
    if format_name not in WRITERS:
        raise unknown_name("format", format_name, WRITERS)
    return WRITERS[format_name](tracks, out)


def _nuscenes(tracks: StoredTracks, out: Path) -> Written:
    return Written(1, write_submission(out, tracks.results))


def _kitti(tracks: StoredTracks, out: Path) -> Written:
    boxes = 0
    results = tracks.results
    for result in results:
        camera = tracks.camera(result.name)
        boxes += kitti.write_tracks(out / f"{result.name}.txt", result, camera)
    return Written(len(results), boxes)


def _argoverse2(tracks: StoredTracks, out: Path) -> Written:
    return Written(3, argoverse2.write_tracks(out, tracks.results))


def _table(tracks: StoredTracks, out: Path) -> Written:
    columns = track_rows(tracks.results)
    write_box_rows(out, columns)
    return Written(1, len(columns["id"]))


def _csv(tracks: StoredTracks, out: Path) -> Written:
    return _table(tracks, _with_suffix(out, ".csv"))


def _parquet(tracks: StoredTracks, out: Path) -> Written:
    return _table(tracks, _with_suffix(out, ".parquet"))


def _mcap(tracks: StoredTracks, out: Path) -> Written:
    try:
        from mottrack.datasets.ros.write_tracks import write_tracks_mcap
    except ImportError as error:
        raise ConfigError(f"mcap files need the extra ros: {error}") from error
    boxes = 0
    for result in tracks.results:
        # a track without a known velocity gets an arrow of no length
        known = {name: getattr(result.tracks, name) for name in result.tracks.COLUMNS}
        known["velocity_mps"] = np.nan_to_num(result.tracks.velocity_mps)
        shown = replace(result, tracks=TrackTable(**known))
        snapshots = tracks.folder.load_snapshots(result.name)
        boxes += write_tracks_mcap(out / f"{result.name}.mcap", shown, snapshots)
    return Written(len(tracks.results), boxes)


def _with_suffix(out: Path, suffix: str) -> Path:
    """Refuse another suffix: `mottrack import` and other readers go by it."""
    if out.suffix != suffix:
        raise ConfigError(f"--out is {out}, expected a name that ends with {suffix}")
    return out


def _mot(tracks: StoredTracks, out: Path) -> Written:
    """Write a file for each class and scene: MOTChallenge's results have no class."""
    files = boxes = 0
    labels = dict.fromkeys(label for r in tracks.results for label in np.unique(r.tracks.label))
    for label in labels:
        for result in tracks.results:
            rows = _mot_rows(tracks, result, str(label))
            write_mot_results(out / str(label) / f"{result.name}.txt", rows)
            files, boxes = files + 1, boxes + len(rows.id)
    return Written(files, boxes)


def _mot_rows(run: StoredTracks, result: SceneResult, label: str) -> MotResults:
    tracks = result.tracks
    if run.kind == "kitti":  # what the camera does not see has no place in its image
        tracks = kitti.seen_tracks(result, run.camera(result.name))
    tracks = tracks.select(np.flatnonzero(tracks.label == label))
    if run.kind == "mot":
        box = to_image(PlaneBoxes(tracks.centre_m, tracks.size_m))
    elif run.kind == "kitti":
        camera = run.camera(result.name)
        seen = kitti.in_camera(tracks, result, camera)
        corners = image_boxes(seen, camera.projection, camera.size)
        box = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
    else:
        box = np.tile(NO_BOX, (len(tracks), 1))
    frame = tracks.frame + 1
    return MotResults(frame, tracks.id, box, tracks.score, tracks.centre_m)


WRITERS: dict[str, Writer] = {
    "nuscenes": _nuscenes,
    "kitti": _kitti,
    "mot": _mot,
    "argoverse2": _argoverse2,
    "csv": _csv,
    "parquet": _parquet,
    "mcap": _mcap,
}
"""Format to its writer."""

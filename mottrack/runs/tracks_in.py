"""Tracks of any tracker made a run, on which report, player and comparison work."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from mottrack.core.errors import ConfigError, DataError, unknown_name
from mottrack.core.frame import Frame
from mottrack.core.interfaces import Dataset, Scene
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.datasets.argoverse2 import results as argoverse2
from mottrack.datasets.argoverse2.config import CLASS_MAP as AV2_CLASS_MAP
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.kitti import results as kitti
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.kitti.config import CLASS_MAP
from mottrack.datasets.kitti.dataset import KittiScene
from mottrack.datasets.mot import dataset as mot
from mottrack.datasets.mot.config import MotConfig
from mottrack.datasets.nuscenes.tracking_file import TrackingFile
from mottrack.datasets.scene_frames import SceneFrames, key_frames
from mottrack.datasets.table_tracks import TrackFrame, table_tracks
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part, load_part
from mottrack.experiment.settings import Settings
from mottrack.experiment.validation_message import format_validation_error
from mottrack.formats.box_table import read_box_rows
from mottrack.formats.faults import MissingError
from mottrack.pipeline.snapshots import SnapshotRecorder
from mottrack.runs.lock import only_driver
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import RunReport
from mottrack.runs.scored_run import ScoredRun

IMPORTED = "imported"
"""Kind of the tracker and of the objects of a run that was imported."""


@dataclass(frozen=True)
class Import:
    """What is imported.

    tracks: files or folders; several are joined, as those of a class each.
    format_name: one of `READERS`.
    dataset: settings of the data set, `kind` among them.
    settings: of the run beside its parts: `name`, `scores`, `snapshots`, `scenes`.
    boxes_in: frame of the boxes of a table.
    """

    tracks: tuple[Path, ...]
    format_name: str
    dataset: Mapping[str, Any]
    settings: Mapping[str, Any] = field(default_factory=dict)
    boxes_in: TrackFrame = "world"


class Imported(NamedTuple):
    """The run, and the scenes of the data set of which the files have nothing."""

    run: ScoredRun
    absent: tuple[str, ...]


OfScene = Callable[[Scene, SceneFrames], ImportedTracks | None]
"""Returns the tracks of a scene; None where the file has none of it."""
Reader = Callable[[Path, "Import"], OfScene]
"""Opens a file or a folder once for all scenes."""


def import_tracks(request: Import, out: Path) -> Imported:
    """Read the tracks of every scene that the files have, and store them as a run.

    Raises:
        ConfigError: the format or a setting is wrong, or the folder belongs to another run.
        DataError: a file is missing or damaged, or the files have no scene of the data set.
    """
    if request.format_name not in READERS:
        raise unknown_name("format", request.format_name, READERS)
    for path in request.tracks:
        if not path.exists():
            raise MissingError(path, "tracks", "missing", "a file or a folder of tracks")
    experiment = _experiment(request)
    dataset: Dataset = experiment.dataset.make()
    files = [READERS[request.format_name](path, request) for path in request.tracks]
    names = experiment.settings.scenes or dataset.scene_names
    folder = RunFolder(out)
    finished: list[str] = []
    with only_driver(out):
        for name in names:
            scene = dataset.scene(name)
            found = _result_of(scene, files)
            if found is None:
                continue
            folder.reserve(experiment)
            keep = len(finished) < experiment.settings.snapshots.scenes
            folder.store_result(found, _snapshots(scene, experiment) if keep else [])
            finished.append(name)
    if not finished:
        expected = f"tracks of {', '.join(names[:3])}, ... ({len(names)} scenes)"
        raise DataError(request.tracks[0], "scenes", "others only", expected)
    report = RunReport(tuple(finished), {}, resumed=0)
    absent = tuple(name for name in names if name not in finished)
    return Imported(ScoredRun(experiment, folder, report), absent)


def _experiment(request: Import) -> Experiment:
    try:
        settings = Settings.model_validate(dict(request.settings))
    except ValidationError as error:
        raise ConfigError(format_validation_error(error, Settings)) from error
    tracker: dict[str, Any] = {
        "format": request.format_name,
        "tracks": [str(path) for path in request.tracks],
        "sha256": _digest(request.tracks),
    }
    if request.format_name == "table":
        tracker["boxes_in"] = request.boxes_in
    return Experiment(
        dataset=_dataset_part(request.dataset),
        objects=Part(IMPORTED, object, {}),
        flow=load_part("flow", {"kind": "zero"}),
        tracker=Part(IMPORTED, object, tracker),
        settings=settings,
    )


def _dataset_part(settings: Mapping[str, Any]) -> Part:
    """Return the data set; that of image boxes is here alone: no tracker of ours runs on it."""
    if settings.get("kind") != mot.MotSequences.name:
        return load_part("dataset", settings)
    given = {key: value for key, value in settings.items() if key != "kind"}
    try:
        config = MotConfig.model_validate(given)
    except ValidationError as error:
        raise ConfigError(format_validation_error(error, MotConfig, prefix="dataset")) from error
    return Part(mot.MotSequences.name, mot.MotSequences, config)


def _digest(paths: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                digest.update(f"{file.name}\0".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _result_of(scene: Scene, files: Sequence[OfScene]) -> SceneResult | None:
    """Return the result of a scene; None where no file has any of it."""
    keys = list(key_frames(scene))
    known = (
        scene.all_frames() if isinstance(scene, KittiScene) else SceneFrames.of(scene.name, keys)
    )
    parts = []
    for number, tracks_of in enumerate(files):
        found = tracks_of(scene, known)
        if found is not None:
            prefix = f"{number}:" if len(files) > 1 else ""
            parts.append(found.renamed(prefix))
    if not parts:
        return None
    tracks = _at_key_frames(ImportedTracks.stacked(parts).table(), known, keys)
    return SceneResult(
        name=scene.name,
        frames=FrameTable.of(keys),
        truth=TruthTable.of(keys),
        tracks=tracks,
        classes=tuple(scene.classes),
    )


def _at_key_frames(tracks: TrackTable, known: SceneFrames, keys: Sequence[Frame]) -> TrackTable:
    """Return the rows of the frames that were asked for, counted among them."""
    row_of = {frame.stamp_ns: row for row, frame in enumerate(keys)}
    place = np.array([row_of.get(stamp, -1) for stamp in known.stamp_ns], np.int64)
    frame = place[tracks.frame] if len(tracks) else tracks.frame
    columns = {name: getattr(tracks, name) for name in tracks.COLUMNS} | {"frame": frame}
    kept = np.flatnonzero(frame >= 0)
    return TrackTable(**{name: values[kept] for name, values in columns.items()})


def _snapshots(scene: Scene, experiment: Experiment) -> list[Snapshot]:
    """Return points and the data set's detections at the key frames, for the player."""
    recorder = SnapshotRecorder(experiment.settings.snapshots.points)
    row = 0
    for index in range(len(scene)):
        frame = scene.frame(index)
        if frame.is_key:
            sweep = scene.sweep(index) if scene.has_sweeps else None
            recorder.take(row, sweep, None, frame.detections)
            row += 1
    return recorder.snapshots


def _file_of(path: Path, scene: str) -> Path | None:
    """Return the text file of a scene; None where the folder, which has one each, lacks it."""
    if path.is_file():
        if path.stem != scene:
            raise DataError(path, "name", path.name, f"{scene}.txt, or the folder of such files")
        return path
    inner = path / "data_0"  # as AB3DMOT lays out its results
    file = (inner if inner.is_dir() else path) / f"{scene}.txt"
    return file if file.exists() else None


def _nuscenes(path: Path, _: Import) -> OfScene:
    file = TrackingFile(path)
    return lambda _, frames: file.tracks([names[0] for names in frames.names])


def _kitti(path: Path, _: Import) -> OfScene:
    def read(scene: Scene, frames: SceneFrames) -> ImportedTracks | None:
        file = _file_of(path, scene.name)
        if file is None:
            return None
        if isinstance(scene, KittiScene):
            return kitti.read_tracks(file, frames, scene.camera, scene.class_map)
        # written of another data set: frames are counted, the camera is KITTI's nominal one
        return kitti.read_tracks(file, frames.numbered(), Camera.nominal(), CLASS_MAP)

    return read


def _mot(path: Path, _: Import) -> OfScene:
    def read(scene: Scene, frames: SceneFrames) -> ImportedTracks | None:
        file = _file_of(path, scene.name)
        if file is None:
            return None
        if not isinstance(scene, mot.MotScene):
            raise ConfigError("boxes in an image have no place in the world: import with mot data")
        return mot.read_tracks(file, frames, scene.classes[0])

    return read


def _argoverse2(path: Path, request: Import) -> OfScene:
    table = argoverse2.read_table(path / argoverse2.TRACKS if path.is_dir() else path)
    given = request.dataset.get("class_map")
    class_map = given if isinstance(given, dict) else AV2_CLASS_MAP
    return lambda _, frames: argoverse2.tracks_of_log(table, frames, class_map)


def _table(path: Path, request: Import) -> OfScene:
    rows = read_box_rows(path, tracks=True)
    return lambda _, frames: table_tracks(rows, frames, request.boxes_in)


READERS: dict[str, Reader] = {
    "nuscenes": _nuscenes,
    "kitti": _kitti,
    "mot": _mot,
    "argoverse2": _argoverse2,
    "table": _table,
}
"""Format to its reader; a table is a csv, Parquet or feather file."""

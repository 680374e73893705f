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
from mottrack.datasets.argoverse2.config import Argoverse2Config
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


class _Source(NamedTuple):
    """A file or folder, and the scene whose tracks are wanted."""

    path: Path
    scene: Scene
    frames: SceneFrames
    request: Import


Reader = Callable[[_Source], ImportedTracks | None]


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
    dataset = _opened(experiment)
    names = experiment.settings.scenes or dataset.scene_names
    folder = RunFolder(out)
    finished: list[str] = []
    with only_driver(out):
        for name in names:
            scene = dataset.scene(name)
            found = _tracks_of(scene, request)
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


def _opened(experiment: Experiment) -> Dataset:
    dataset: Dataset = experiment.dataset.make()
    return dataset


def _digest(paths: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                digest.update(f"{file.name}\0".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _tracks_of(scene: Scene, request: Import) -> SceneResult | None:
    """Return the result of a scene; None where no file has any of it."""
    keys = list(key_frames(scene))
    known = (
        scene.all_frames() if isinstance(scene, KittiScene) else SceneFrames.of(scene.name, keys)
    )
    parts = []
    for number, path in enumerate(request.tracks):
        found = READERS[request.format_name](_Source(path, scene, known, request))
        if found is not None:
            prefix = f"{number}:" if len(request.tracks) > 1 else ""
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


def _file_of(source: _Source, suffix: str) -> Path | None:
    """Return the file of a scene; None where the folder, which has one each, lacks it."""
    if source.path.is_file():
        if source.path.stem != source.scene.name:
            expected = f"{source.scene.name}{suffix}, or the folder of such files"
            raise DataError(source.path, "name", source.path.name, expected)
        return source.path
    inner = source.path / "data_0"  # as AB3DMOT lays out its results
    folder = inner if inner.is_dir() else source.path
    path = folder / f"{source.scene.name}{suffix}"
    return path if path.exists() else None


def _nuscenes(source: _Source) -> ImportedTracks | None:
    tokens = [names[0] for names in source.frames.names]
    return TrackingFile(source.path).tracks(tokens)


def _kitti(source: _Source) -> ImportedTracks | None:
    path = _file_of(source, ".txt")
    if path is None:
        return None
    if isinstance(source.scene, KittiScene):
        camera, class_map = source.scene.camera, source.scene.class_map
        return kitti.read_tracks(path, source.frames, camera, class_map)
    # written of another data set: frames are counted, the camera is KITTI's nominal one
    frames = source.frames.numbered()
    return kitti.read_tracks(path, frames, Camera.nominal(), dict(CLASS_MAP))


def _mot(source: _Source) -> ImportedTracks | None:
    path = _file_of(source, ".txt")
    if path is None:
        return None
    if not isinstance(source.scene, mot.MotScene):
        raise ConfigError("boxes in an image have no place in the world: import them with mot data")
    return mot.read_tracks(path, source.frames, source.scene.classes[0])


def _argoverse2(source: _Source) -> ImportedTracks | None:
    path = source.path / argoverse2.TRACKS if source.path.is_dir() else source.path
    config = Argoverse2Config(root=Path())
    given = source.request.dataset.get("class_map")
    if isinstance(given, dict):
        config = config.model_copy(update={"class_map": given})
    return argoverse2.read_tracks(path, source.frames, config)


def _table(source: _Source) -> ImportedTracks | None:
    return table_tracks(source.path, source.frames, source.request.boxes_in)


READERS: dict[str, Reader] = {
    "nuscenes": _nuscenes,
    "kitti": _kitti,
    "mot": _mot,
    "argoverse2": _argoverse2,
    "table": _table,
}
"""Format to its reader; a table is a csv, Parquet or feather file."""

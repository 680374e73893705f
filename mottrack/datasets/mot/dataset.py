"""MOTChallenge sequences, read as they were downloaded."""

from __future__ import annotations

import configparser
from functools import cached_property
from pathlib import Path

import numpy as np

from mottrack.core import DataError, Frame, Pose, Sweep, TruthTable
from mottrack.core.arrays import F64, I64
from mottrack.core.label_velocities import centred_velocities
from mottrack.core.sweep import SECOND_NS
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.mot.config import MotConfig
from mottrack.datasets.mot.plane import to_plane
from mottrack.datasets.scene_boxes import truth_of, unknown_velocities
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.scenes import checked_index, chosen_scenes, require_scene
from mottrack.formats.columns import Columns
from mottrack.formats.faults import MissingError
from mottrack.formats.files import existing_folder, read_text
from mottrack.formats.mot_rows import BOX, read_mot_rows

MAX_FRAMES = 1_000_000
"""Eleven hours at 25 Hz; the longest sequence of the benchmarks has 3,000."""
PEDESTRIAN = 1
"""Number of the class that counts, where files have classes (MOT16 and later)."""
CLASSES = 13
"""Numbered from 1 in MOT16, MOT17 and MOT20; another number in the column is no class."""
TRUTH_FILES = ("gt/gt.txt", "gt.txt")


class MotSequences:
    """The sequences of a folder: truth in the image, laid flat (`mottrack.datasets.mot.plane`)."""

    Config = MotConfig
    name = "mot"

    def __init__(self, config: MotConfig) -> None:
        self._config = config
        existing_folder(config.root, "root")

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen sequences, or all folders with truth."""
        root = self._config.root
        found = {
            p.relative_to(root).parts[0] for name in TRUTH_FILES for p in root.glob(f"*/{name}")
        }
        if not found:
            raise MissingError(root, "scenes", "none", f"<sequence>/{TRUTH_FILES[0]}")
        return chosen_scenes(self._config.scenes, tuple(sorted(found)))

    def scene(self, name: str) -> MotScene:
        """Open one sequence.

        Raises:
            ConfigError: no sequence has that name.
            DataError: a file of it is missing or damaged.
        """
        require_scene(name, self.scene_names)
        return MotScene(self._config.root / name, self._config)


class MotScene:
    """Frames of one sequence; the token is the frame's number, from 1 on. There is no sweep."""

    has_sweeps = False

    def __init__(self, folder: Path, config: MotConfig) -> None:
        self._folder, self._config = folder, config
        path = next((folder / name for name in TRUTH_FILES if (folder / name).exists()), None)
        if path is None:
            raise MissingError(folder / TRUTH_FILES[0], "file", "missing", "the truth")
        self._rows = _counted(read_mot_rows(path))
        frames = self._rows["frame"]
        self._rows.refuse("frame", (frames < 1) | (frames > MAX_FRAMES), f"1 .. {MAX_FRAMES}")
        self._info = _sequence_info(folder / "seqinfo.ini")
        self._count = self._info.get("seqlength") or int(frames.max(initial=0))
        if not self._count:
            raise DataError(path, "rows", 0, "at least one box")
        self._rows.refuse("frame", frames > self._count, f"at most {self._count}, seqLength")

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self._folder.name

    @property
    def classes(self) -> tuple[str, ...]:
        """The class of all boxes."""
        return (self._config.label,)

    def __len__(self) -> int:
        return self._count

    def frame(self, index: int) -> Frame:
        """Return the frame at `index`, boxes on the plane."""
        place = checked_index(index, len(self), self.name)
        stamp_ns = int(self._stamps_ns[place])
        truth = truth_of(self._truth, place, stamp_ns)
        return Frame(stamp_ns, self._middle, truth=truth, token=str(place + 1))

    def sweep(self, index: int) -> Sweep:
        """Refuse: an image has no points."""
        raise MissingError(self._folder, f"sweep {index}", "missing", "a data set with sweeps")

    def frames(self) -> SceneFrames:
        """Return the frames as result files know them: by their number."""
        names = tuple((str(n + 1),) for n in range(len(self)))
        poses = (self._middle,) * len(self)
        return SceneFrames(self.name, names, tuple(self._stamps_ns.tolist()), poses)

    @cached_property
    def _middle(self) -> Pose:
        """The middle of all true boxes, around which pictures are drawn."""
        centre_m = to_plane(_boxes(self._rows)).centre_m
        middle = (centre_m.min(axis=0) + centre_m.max(axis=0)) / 2 if len(centre_m) else np.zeros(3)
        return Pose(np.eye(3), middle)

    @cached_property
    def _stamps_ns(self) -> I64:
        rate_hz = self._info.get("framerate") or self._config.rate_hz
        return np.round(np.arange(len(self)) * SECOND_NS / rate_hz).astype(np.int64)

    @cached_property
    def _truth(self) -> TruthTable:
        rows = self._rows
        frame, identity = _integers(rows, "frame") - 1, _integers(rows, "id")
        boxes = to_plane(_boxes(rows))
        return TruthTable(
            frame=frame,
            id=identity,
            label=np.full(len(rows), self._config.label),
            centre_m=boxes.centre_m,
            size_m=boxes.size_m,
            yaw_rad=np.zeros(len(rows)),
            velocity_mps=centred_velocities(identity, self._stamps_ns[frame], boxes.centre_m),
            num_points=np.full(len(rows), -1),
            interpolated=np.zeros(len(rows), np.bool_),
        )


def read_tracks(path: Path, frames: SceneFrames, label: str) -> ImportedTracks:
    """Read a tracker's result of one sequence, on the plane.

    Raises:
        DataError: a broken line, or a frame that the sequence lacks.
    """
    rows = read_mot_rows(path)
    number = rows["frame"]
    last = len(frames.stamp_ns)
    rows.refuse("frame", (number < 1) | (number > last), f"1 .. {last} of {frames.scene}")
    boxes = to_plane(_boxes(rows))
    return ImportedTracks(
        frame=_integers(rows, "frame") - 1,
        label=np.full(len(rows), label),
        score=rows["confidence"],
        centre_m=boxes.centre_m,
        size_m=boxes.size_m,
        yaw_rad=np.zeros(len(rows)),
        velocity_mps=unknown_velocities(len(rows)),
        track=_integers(rows, "id").astype(np.str_),
        observed=np.ones(len(rows), np.bool_),
    )


def _integers(rows: Columns, name: str) -> I64:
    return rows[name].astype(np.int64)


def _boxes(rows: Columns) -> F64:
    return rows.stacked(BOX)


def _counted(rows: Columns) -> Columns:
    """Return the true boxes that count: of confidence other than 0, of the class pedestrian."""
    kinds = rows["class"]
    counted = rows["confidence"] != 0
    if len(rows) and np.isin(kinds, np.arange(1, CLASSES + 1)).all():
        counted &= kinds == PEDESTRIAN
    return rows.select(np.flatnonzero(counted))


def _sequence_info(path: Path) -> dict[str, int]:
    """Return frameRate and seqLength of a `seqinfo.ini`, names in lower case; none without one."""
    if not path.exists():
        return {}
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(path))
        given = parser["Sequence"] if parser.has_section("Sequence") else {}
        found = {n: int(given[n]) for n in ("framerate", "seqlength") if n in given}
    except (configparser.Error, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(path, "content", reason, "[Sequence] with frameRate, seqLength") from error
    for name, value in found.items():
        if not 0 < value <= MAX_FRAMES:
            raise DataError(path, name, value, f"1 .. {MAX_FRAMES}")
    return found

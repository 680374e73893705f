"""The stored result of a scene, from which every evaluation starts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64
from mottrack.core.checks import require_all, require_finite, set_array
from mottrack.core.concerns import Concern
from mottrack.core.errors import InputError, ResultError
from mottrack.core.pictures import INK, TRACK, TRUTH, Plan, captioned
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.core.sweep import SECOND_NS
from mottrack.core.tables import FlowSamples, FrameTable, Table, TrackTable, TruthTable

FORMAT = "mottrack scene result 4"
TABLES: dict[str, type[Table]] = {
    "frames": FrameTable,
    "truth": TruthTable,
    "tracks": TrackTable,
    "flow": FlowSamples,
}
BOXES = (
    *("name", "classes", "hull_xy_m"),
    *("concerns.kind", "concerns.count", "concerns.example"),
    *(f"{prefix}.{c}" for prefix, kind in TABLES.items() if prefix != "flow" for c in kind.COLUMNS),
)
"""Arrays of a stored result without the samples of its flow."""
NO_FLOW = FlowSamples.empty()
"""Stands for samples that are not read."""


@dataclass(frozen=True, slots=True)
class SceneResult:
    """Truth and estimates of one scene as flat arrays, world frame.

    Stage timings are not in the stored file: two runs of the same scene with the same
    configuration store the same bytes.

    Raises:
        InputError: a row names a frame that does not exist, or the hull corners do not add up.
    """

    name: str
    """Name of the scene."""
    frames: FrameTable
    truth: TruthTable
    tracks: TrackTable
    flow: FlowSamples = field(default_factory=FlowSamples.empty)
    hull_xy_m: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    """(sum of tracks.hull_corners, 2) hull corners of all tracks, one after the other."""
    timings_s: dict[str, F64] = field(default_factory=dict)
    """Per stage (T,) seconds spent on each frame."""
    classes: tuple[str, ...] = ()
    """Labels that scores count; empty: every label that occurs."""
    concerns: tuple[Concern, ...] = ()
    """What of the scene's data was left out or is hardly meant."""

    def __post_init__(self) -> None:
        hull = set_array(self, "hull_xy_m", np.float64, (None, 2))
        require_finite("hull_xy_m", hull)
        corners = int(self.tracks.hull_corners.sum())
        if corners != len(hull):
            raise InputError("length of hull_xy_m", len(hull), str(corners))
        for name, table in (("truth", self.truth), ("tracks", self.tracks), ("flow", self.flow)):
            there = (table.frame >= 0) & (table.frame < len(self.frames))
            require_all(f"{name}.frame", table.frame, there, f"one of {len(self.frames)} frames")

    def __repr__(self) -> str:
        stamps = self.frames.stamp_ns
        seconds = float(stamps[-1] - stamps[0]) / SECOND_NS if len(stamps) else 0.0
        tracks, objects = (len(np.unique(table.id)) for table in (self.tracks, self.truth))
        return (
            f"SceneResult({self.name!r}, {len(stamps)} key frames over {seconds:.1f} s, "
            f"{tracks} tracks, {objects} true objects)"
        )

    def _repr_html_(self) -> str:
        """Return a picture for notebooks: the paths of tracks, true objects and the vehicle."""
        ego = self.frames.world_T_ego[:, :2, 3]
        plan = Plan(np.concatenate([ego, self.tracks.centre_m[:, :2], self.truth.centre_m[:, :2]]))
        for table, colour in ((self.truth, TRUTH), (self.tracks, TRACK)):
            order = np.lexsort((table.frame, table.id))
            _, first = np.unique(table.id[order], return_index=True)
            for path in np.split(table.centre_m[order, :2], first[1:]):
                plan.line(path, colour)
        plan.line(ego, INK)
        text = f"{self!r}; tracks orange, truth green, the vehicle grey"
        return captioned(text, plan.markup())

    @property
    def hulls(self) -> list[F64]:
        """Per track row its (K, 2) hull corners; K is 0 where the track has only a box."""
        ends = np.cumsum(self.tracks.hull_corners)
        return np.split(self.hull_xy_m, ends[:-1]) if len(ends) else []

    def where_labelled(self) -> SceneResult:
        """Return the result without boxes outside the labelled area or frames.

        KITTI labels what its camera sees, and an own log may have frames without labels: a track
        there is no error.
        """
        truth = self.frames.labelled(self.truth.frame, self.truth.centre_m)
        tracks = self.frames.labelled(self.tracks.frame, self.tracks.centre_m)
        if truth.all() and tracks.all():
            return self
        hulls = [hull for hull, kept in zip(self.hulls, tracks, strict=True) if kept]
        return replace(
            self,
            truth=self.truth.select(truth),
            tracks=self.tracks.select(tracks),
            hull_xy_m=np.concatenate(hulls) if hulls else np.zeros((0, 2)),
        )

    def save(self, path: Path | str) -> None:
        """Write everything but the timings, atomically."""
        arrays: dict[str, NDArray[np.generic]] = {
            "name": np.array(self.name),
            "classes": np.array(self.classes, dtype=np.str_),
            "hull_xy_m": self.hull_xy_m,
            "concerns.kind": np.array([c.kind for c in self.concerns], dtype=np.str_),
            "concerns.count": np.array([c.count for c in self.concerns], dtype=np.int64),
            "concerns.example": np.array([c.example for c in self.concerns], dtype=np.str_),
        }
        for prefix, kind in TABLES.items():
            table = getattr(self, prefix)
            arrays |= {f"{prefix}.{column}": getattr(table, column) for column in kind.COLUMNS}
        write_arrays(Path(path), arrays, FORMAT)

    @classmethod
    def load(cls, path: Path | str, *, flow: bool = True) -> SceneResult:
        """Read what ``save`` wrote.

        Args:
            path: of the file.
            flow: whether to read the samples of the flow, most of the file.

        Raises:
            ResultError: the file is missing, damaged, or of another version.
        """
        path = Path(path)
        arrays = read_arrays(path, FORMAT, None if flow else BOXES)
        if not flow:
            arrays |= {f"flow.{c}": getattr(NO_FLOW, c) for c in FlowSamples.COLUMNS}
        try:
            tables = {
                prefix: kind(**{c: arrays[f"{prefix}.{c}"] for c in kind.COLUMNS})
                for prefix, kind in TABLES.items()
            }
            return cls(
                str(arrays["name"]),
                hull_xy_m=arrays["hull_xy_m"],
                classes=tuple(arrays["classes"].tolist()),
                concerns=_concerns(arrays),
                **tables,  # type: ignore[arg-type]
            )
        except InputError as error:
            raise ResultError(path, error.field, error.value, error.expected) from error


def _concerns(arrays: dict[str, NDArray[Any]]) -> tuple[Concern, ...]:
    columns = (arrays[f"concerns.{name}"].tolist() for name in ("kind", "count", "example"))
    return tuple(Concern(*row) for row in zip(*columns, strict=True))

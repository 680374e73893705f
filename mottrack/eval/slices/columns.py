"""Columns by which boxes are sliced: what each box is called in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.core.errors import unknown_name
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.arithmetic import SPEED_EDGES_MPS
from mottrack.eval.flow_error import RANGE_EDGES_M
from mottrack.eval.tracked_scenes import TrackedScenes

POINT_EDGES = (0.0, 1.0, 5.0, 20.0, 100.0, np.inf)
"""LiDAR returns: none, too few for a shape, for a heading, a whole vehicle nearby."""
HIDDEN_EDGES = (0.0, 0.1, 0.5, 0.9, 1.01)
"""Hidden shares: in the open, partly, largely, all but a tenth (the last bin holds 1)."""
FEW_VALUES = 8
"""A column of numbers with more different values than this is cut at its quartiles."""
UNKNOWN = ""
"""The slice of boxes of which a column says nothing: they are in none."""


@dataclass(frozen=True)
class Boxes:
    """The boxes of one class in one scene that count."""

    scenes: TrackedScenes
    index: int
    """Of the scene."""
    truth: TruthTable
    tracks: TrackTable

    @property
    def result(self) -> SceneResult:
        """The scene."""
        return self.scenes.part(self.index)

    def range_m(self, table: TruthTable | TrackTable) -> F64:
        """Return the distance of boxes from the vehicle over the ground, (N,)."""
        ego_xy_m = self.result.frames.world_T_ego[table.frame, :2, 3]
        return np.asarray(np.hypot(*(table.centre_m[:, :2] - ego_xy_m).T))


@dataclass(frozen=True)
class Named:
    """The slice of each box; a column that says nothing of tracks has no names of them."""

    truth: Texts
    """(M,)"""
    tracks: Texts | None = None
    """(N,)"""


def column(name: str, boxes: Boxes) -> Named:
    """Return the slices of the boxes in a column.

    Raises:
        ConfigError: there is no column of that name.
    """
    own = boxes.scenes.columns
    if name in own:
        return _own(name, boxes)
    if name not in COLUMNS:
        raise unknown_name("--by", name, sorted({*COLUMNS, *own}))
    return COLUMNS[name](boxes)


def binned(values: F64, edges: Sequence[float], unit: str) -> Texts:
    """Return the bin [low, high) of each value as text, `UNKNOWN` outside of all, (N,).

    >>> binned(np.array([0.5, 7.0, np.nan]), (0.0, 1.0, np.inf), "m").tolist()
    ['[0, 1) m', '[1, inf) m', '']
    """
    names = np.array([f"[{low:g}, {high:g}) {unit}".rstrip() for low, high in pairwise(edges)])
    place = np.searchsorted(np.asarray(edges), values, side="right") - 1
    known = np.isfinite(values) & (place >= 0) & (place < len(names))
    return np.where(known, names[np.where(known, place, 0)], UNKNOWN)


def _class(boxes: Boxes) -> Named:
    return Named(boxes.truth.label, boxes.tracks.label)


def _range(boxes: Boxes) -> Named:
    sides = (boxes.range_m(table) for table in (boxes.truth, boxes.tracks))
    return Named(*(binned(range_m, RANGE_EDGES_M, "m") for range_m in sides))


def _speed(boxes: Boxes) -> Named:
    true_mps = np.hypot(*boxes.truth.velocity_mps.T)
    known = boxes.scenes.known_velocity(boxes.tracks)
    said_mps = np.where(known, np.hypot(*boxes.tracks.velocity_mps.T), np.nan)
    true, said = (binned(np.asarray(v), SPEED_EDGES_MPS, "m/s") for v in (true_mps, said_mps))
    return Named(true, None if boxes.scenes.velocities == "none" else said)


def _points(boxes: Boxes) -> Named:
    points = boxes.truth.num_points.astype(np.float64)
    return Named(binned(np.where(points < 0, np.nan, points), POINT_EDGES, "returns"))


def _occlusion(boxes: Boxes) -> Named:
    shares = boxes.scenes.hidden(boxes.index)
    keys = zip(boxes.truth.frame.tolist(), boxes.truth.id.tolist(), strict=True)
    hidden = np.array([shares[key] for key in keys], np.float64)
    return Named(binned(hidden, HIDDEN_EDGES, "hidden"))


def _scene(boxes: Boxes) -> Named:
    name = boxes.result.name
    return Named(np.full(len(boxes.truth), name), np.full(len(boxes.tracks), name))


COLUMNS: Mapping[str, Callable[[Boxes], Named]] = {
    "class": _class,
    "range": _range,
    "speed": _speed,
    "points": _points,
    "occlusion": _occlusion,
    "scene": _scene,
}
"""Columns that every data set has."""


def _own(name: str, boxes: Boxes) -> Named:
    """Return a column that was given: of a scene, of an object or of a box."""
    listed = boxes.scenes.columns[name]
    values = listed[boxes.index]
    truth = boxes.scenes.column(name, boxes.index, boxes.truth)
    edges = _quartiles(listed)
    numbers = edges is not None
    named = binned(_numbers(truth), edges, "") if edges is not None else truth
    if None not in values or len(values) > 1:
        return Named(named)
    of_scene = str(values[None])
    whole = binned(_numbers(np.array([of_scene])), edges or (), "")[0] if numbers else of_scene
    return Named(named, np.full(len(boxes.tracks), whole))


def _quartiles(listed: Sequence[Mapping[object, str | float]]) -> tuple[float, ...] | None:
    """Return the edges of the quarters of a column of many numbers; None for names."""
    values = [value for values in listed for value in values.values()]
    numbers = np.unique(_numbers(np.array([str(value) for value in values], np.str_)))
    if len(numbers) <= FEW_VALUES or not np.isfinite(numbers).all():
        return None
    inner = np.quantile(numbers, (0.25, 0.5, 0.75)).tolist()
    return (-np.inf, *inner, np.inf)


def _numbers(texts: Texts) -> F64:
    """Return texts as numbers, NaN where they are none, (N,)."""
    return np.array([_number(text) for text in texts.tolist()], np.float64)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")

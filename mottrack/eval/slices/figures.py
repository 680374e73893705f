"""Figures of each slice of a column, resampled by scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Texts
from mottrack.eval import clear
from mottrack.eval.arithmetic import mota, ratio
from mottrack.eval.paired import Metric, MetricKey, Pooled, Sampled, sample
from mottrack.eval.pairs import BoxStream, centre_distance, find_pairs
from mottrack.eval.slices.columns import UNKNOWN, Boxes, Named, column
from mottrack.eval.tracked_scenes import TrackedScenes

TABLE = "slice"
RECALL, PRECISION, MOTA = "recall", "precision", "MOTA"
SWITCHES, PLACE, VELOCITY = "switches of 100 matches", "position error", "velocity error"
UNITS = {PLACE: "m", VELOCITY: "m/s"}
HIGHER = (RECALL, PRECISION, MOTA)
"""Figures that are better when higher."""
FIGURES = (RECALL, PRECISION, MOTA, SWITCHES, PLACE, VELOCITY)
_SUMS = ("truth", "hits", "switches", "place_m", "known", "velocity_mps", "tracks", "right")
"""Of one slice and scene; the last two are NaN where the column says nothing of tracks."""


@dataclass(frozen=True)
class Slice:
    """One value of a column."""

    column: str
    name: str
    boxes: int
    """True boxes in it."""
    figures: dict[MetricKey, Sampled]


def slices(scenes: TrackedScenes, by: Sequence[str], weights: I64) -> list[Slice]:
    """Return the figures of every value of the columns, largest slice first where it has no order.

    Args:
        scenes: with truth and tracks; boxes match as in all figures of a run.
        by: names of columns.
        weights: (B, S) how often each scene counts in each resample.

    Raises:
        ConfigError: a column is not known.
    """
    summed: dict[str, list[dict[str, F64]]] = {name: [] for name in by}
    for index in range(len(scenes.results)):  # one scene is held at a time
        parts = list(_matched(scenes, index))
        for name in by:
            summed[name].append(_sums(name, parts))
    found: list[Slice] = []
    for name, sums in summed.items():
        values = sorted({value for scene in sums for value in scene}, key=_order)
        found += [_slice(name, value, sums, weights) for value in values]
    return found


@dataclass(frozen=True)
class _Matched:
    """Boxes of one class in one scene and what each true one is matched with."""

    boxes: Boxes
    association: clear.Association


def _matched(scenes: TrackedScenes, index: int) -> Iterator[_Matched]:
    result, config = scenes.part(index), scenes.config
    for one in scenes.filters:
        truth, tracks = scenes.boxes(index, one)
        pairs = find_pairs(
            BoxStream(truth.frame, truth.id),
            BoxStream(tracks.frame, tracks.id),
            len(result.frames),
            centre_distance(truth.centre_m, tracks.centre_m, config.match_distance_m),
        )
        near = pairs.within(config.match_distance_m)
        yield _Matched(Boxes(scenes, index, truth, tracks), clear.associate(near))


def _sums(name: str, parts: Sequence[_Matched]) -> dict[str, F64]:
    """Return `_SUMS` of every slice of a scene, all classes together."""
    found: dict[str, F64] = {}
    for part in parts:
        named = column(name, part.boxes)
        per_box, per_track = _truth_values(part), _track_values(part)
        for value in _values(named):
            row = np.zeros(len(_SUMS))
            row[: per_box.shape[1]] = per_box[named.truth == value].sum(axis=0)
            row[per_box.shape[1] :] = np.nan
            if named.tracks is not None:
                row[per_box.shape[1] :] = per_track[named.tracks == value].sum(axis=0)
            found[value] = found.get(value, np.zeros(len(_SUMS))) + row
    return found


def _values(named: Named) -> list[str]:
    sides: list[Texts] = [named.truth] if named.tracks is None else [named.truth, named.tracks]
    return [str(v) for v in np.unique(np.concatenate(sides)) if v != UNKNOWN]


def _truth_values(part: _Matched) -> F64:
    """Return the first six of `_SUMS` for each true box, (M, 6)."""
    truth, tracks, found = part.boxes.truth, part.boxes.tracks, part.association
    hit = found.track_row >= 0
    row = np.where(hit, found.track_row, 0)
    error_mps = np.full(len(truth), np.nan)
    if len(tracks):
        apart = tracks.velocity_mps[row] - truth.velocity_mps
        usable = hit & part.boxes.scenes.known_velocity(tracks)[row] & ~truth.interpolated
        error_mps = np.where(usable, np.hypot(*apart.T), np.nan)
    known = np.isfinite(error_mps)
    return np.column_stack(
        [
            np.ones(len(truth)),
            hit,
            found.switched,
            np.nan_to_num(found.distance),
            known,
            np.where(known, error_mps, 0.0),
        ]
    )


def _track_values(part: _Matched) -> F64:
    """Return the last two of `_SUMS` for each track box, (N, 2)."""
    right = np.zeros(len(part.boxes.tracks))
    right[part.association.track_row[part.association.track_row >= 0]] = 1.0
    return np.column_stack([np.ones(len(right)), right])


def _slice(name: str, value: str, scenes: Sequence[Mapping[str, F64]], weights: I64) -> Slice:
    none = np.zeros(len(_SUMS))
    rows = np.array([scene.get(value, none) for scene in scenes])
    truth, hits, switches, place, known, velocity, tracks, right = rows.T
    metrics: dict[str, Metric] = {
        RECALL: Pooled(ratio, (hits, truth)),
        SWITCHES: Pooled(_per_hundred, (switches, hits)),
        PLACE: Pooled(ratio, (place, hits)),
        VELOCITY: Pooled(ratio, (velocity, known)),
    }
    if not np.isnan(tracks).any():
        metrics[PRECISION] = Pooled(ratio, (right, tracks))
        errors = (truth - hits) + (tracks - right) + switches
        metrics[MOTA] = Pooled(mota, (errors, truth))
    keys = {figure: figure_key(name, value, figure) for figure in metrics}
    figures = {keys[f]: sample(metric, weights) for f, metric in metrics.items()}
    shown = {key: found for key, found in figures.items() if np.isfinite(found.value)}
    return Slice(name, value, int(truth.sum()), shown)


def _per_hundred(part: F64, whole: F64) -> F64:
    return 100.0 * ratio(part, whole)


def figure_key(name: str, value: str, figure: str) -> MetricKey:
    """Return the key of a figure of a slice."""
    unit = UNITS.get(figure, "")
    return MetricKey(TABLE, f"{name}: {value}", figure, unit, lower_is_better=figure not in HIGHER)


def _order(value: str) -> tuple[float, str]:
    """Sort bins by their lower edge, everything else by name."""
    if not value.startswith("["):
        return 0.0, value
    return float(value[1:].split(",")[0]), value

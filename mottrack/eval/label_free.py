"""Scores of a flow source that need no labels: figures from sums over the frames of a scene.

Geometry says which objects moved and which rested (`pipeline.label_free`); the source did not.

    moving residual   root mean square, over the points of objects that moved, of what remains of
                      their displacement after they are moved by the flow, over the elapsed time:
                      an estimate of the dynamic RMSE. Zero flow has the largest
    static residual   root mean square speed that is claimed of objects at rest: an estimate of the
                      static RMSE where the earlier sweep saw the place. Zero flow has 0
    error             root of their weighted mean square: what moves counts a quarter
    explained         share of the distances between two sweeps that remains of no flow and is gone
                      after the flow. Zero flow has 0 %
    consistent        share of the points of moving objects that are claimed to move, and of which
                      the flow of the reversed pair says the opposite. Zero flow has 0 %
    NIS               of the tracks' positions over its expectation, with a tracker that states it

Every figure but the NIS is a function of sums, so scenes are judged one by one and drawn again for
intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import ResultError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.eval.arithmetic import ratio
from mottrack.eval.paired import MetricKey, Pooled, Sampled, sample

FORMAT = "mottrack label-free sums 1"
TABLE = "label-free"
MOVING_WEIGHT = 0.25
"""Of what moves in the error. By points (2 to 15 %) no flow would beat a raw network on KITTI; from
a tenth to a half the order of sources on six drives is about as near to that of their RMSE."""


@dataclass(frozen=True, slots=True)
class LabelFreeSums:
    """What the frames of a scene contribute; points are thinned ones."""

    frames: float = 0.0
    """Frames that were judged."""
    seen: float = 0.0
    """Points of either sweep of a pair that the other sweep could see."""
    residual_m: float = 0.0
    """Their truncated distances to the other sweep after the flow."""
    at_rest_m: float = 0.0
    """The same without flow."""
    moving: float = 0.0
    """Points of objects that moved."""
    moving_m2ps2: float = 0.0
    """Squared remaining displacement over elapsed time, over those points."""
    static: float = 0.0
    """Points of objects at rest."""
    static_m2ps2: float = 0.0
    """Squared speed claimed of them."""
    static_fast: float = 0.0
    """Those of which more than 1 m/s is claimed."""
    reversed: float = 0.0
    """Points of objects that moved, in pairs that were measured in both directions."""
    agreeing: float = 0.0
    """Those whose two velocities are opposite."""
    nis: float = 0.0
    """Normalised innovation squared of the tracks' positions, over its expectation."""
    innovations: float = 0.0
    """Number of innovations."""

    def __add__(self, other: LabelFreeSums) -> LabelFreeSums:
        """Return the sums of both."""
        return LabelFreeSums(*(a + b for a, b in zip(self.row(), other.row(), strict=True)))

    def row(self) -> list[float]:
        """Return the sums in their order."""
        return [getattr(self, name) for name in NAMES]


NAMES = tuple(field.name for field in fields(LabelFreeSums))


def _root(total: F64, count: F64) -> F64:
    return np.sqrt(ratio(total, count))


def _balanced(moving: F64, points: F64, static: F64, count: F64) -> F64:
    mean_square = MOVING_WEIGHT * ratio(moving, points)
    return np.sqrt(mean_square + (1.0 - MOVING_WEIGHT) * ratio(static, count))


def _percent(total: F64, count: F64) -> F64:
    return 100.0 * ratio(total, count)


def _gain_percent(residual: F64, at_rest: F64) -> F64:
    return 100.0 * (1.0 - ratio(residual, at_rest))


ERROR = MetricKey(TABLE, "all", "error", "m/s")
"""The figure that ranks sources: no flow pays for what moves, an inventive one for what rests."""
MOVING = MetricKey(TABLE, "moving", "residual", "m/s")
STATIC = MetricKey(TABLE, "static", "residual", "m/s")
STATIC_FAST = MetricKey(TABLE, "static", "over 1 m/s", "%")
EXPLAINED = MetricKey(TABLE, "all", "explained", "%", lower_is_better=False)
CONSISTENT = MetricKey(TABLE, "moving", "consistent", "%", lower_is_better=False)
NIS = MetricKey(TABLE, "tracks", "NIS")
KEYS = (ERROR, MOVING, STATIC, STATIC_FAST, EXPLAINED, CONSISTENT, NIS)
COMPARED = KEYS[:-1]
"""Without the NIS, of which 1 is best: a difference of it is neither better nor worse."""


@dataclass(frozen=True)
class SceneJudgements:
    """The sums of S scenes (or stretches of a log) side by side."""

    scenes: tuple[LabelFreeSums, ...]

    def metric(self, key: MetricKey) -> Pooled:
        """Return a figure as a function of how often each scene counts."""
        of = dict(zip(NAMES, np.array([s.row() for s in self.scenes]).T, strict=True))
        moving, static = (of["moving_m2ps2"], of["moving"]), (of["static_m2ps2"], of["static"])
        return {
            ERROR: Pooled(_balanced, (*moving, *static)),
            MOVING: Pooled(_root, moving),
            STATIC: Pooled(_root, static),
            STATIC_FAST: Pooled(_percent, (of["static_fast"], of["static"])),
            EXPLAINED: Pooled(_gain_percent, (of["residual_m"], of["at_rest_m"])),
            CONSISTENT: Pooled(_percent, (of["agreeing"], of["reversed"])),
            NIS: Pooled(ratio, (of["nis"], of["innovations"])),
        }[key]

    def sampled(self, weights: I64) -> dict[MetricKey, Sampled]:
        """Return every figure that the scenes have data for, on resamples (B, S) of them."""
        metrics = {key: self.metric(key) for key in KEYS}
        return {k: sample(m, weights) for k, m in metrics.items() if m.present.any()}


def save_judgement(path: Path, sums: LabelFreeSums) -> None:
    """Store the sums of a scene, atomically."""
    write_arrays(path, {"sums": np.array(sums.row())}, FORMAT)


def load_judgement(path: Path) -> LabelFreeSums:
    """Read what `save_judgement` wrote.

    Raises:
        ResultError: the file is missing, damaged, or of another version.
    """
    sums = read_arrays(path, FORMAT)["sums"]
    if sums.shape != (len(NAMES),) or not np.isfinite(sums).all() or (sums < 0).any():
        raise ResultError(path, "sums", sums.shape, f"{len(NAMES)} numbers, none negative")
    return LabelFreeSums(*sums.tolist())


def total(parts: Sequence[LabelFreeSums]) -> LabelFreeSums:
    """Return the sums of several frames or scenes together."""
    return sum(parts, LabelFreeSums())

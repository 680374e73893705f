"""Detections matched with the truth, collected over scenes to estimate the noise."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import InputError
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Boxes, Objects, Truth
from mottrack.trackers.association import candidate_pairs, centre_distance_m, hungarian

MATCH_RADIUS_M = 2.0
"""Largest distance of a detection from a true box of its class (as Chiu et al., 2020)."""


@dataclass(frozen=True, slots=True)
class NoiseSamples:
    """N detections matched with the truth, and M true boxes, matched or not.

    Boxes are rows of x, y, z, yaw, l, w, h in the world frame; objects are numbered through all
    scenes.
    """

    label: Texts
    """(N,)"""
    detection: F64
    """(N, 7)"""
    truth: F64
    """(N, 7)"""
    velocity_error: F64
    """(N, 2) measured less true velocity in m/s; NaN where none was measured."""
    true_label: Texts
    """(M,)"""
    true_object: I64
    """(M,)"""
    true_stamp_ns: I64
    """(M,)"""
    true_box: F64
    """(M, 7)"""


@dataclass
class SampleCollector:
    """Collects samples frame by frame."""

    _frames: list[NoiseSamples] = field(default_factory=list)
    _numbers: dict[tuple[str, int], int] = field(default_factory=dict)

    def add(self, scene: str, objects: Objects, truth: Truth) -> None:
        """Add one frame of a scene: its detections, with or without velocities, and its truth."""
        i, j = match_truth(objects, truth)
        numbers = [
            self._numbers.setdefault((scene, k), len(self._numbers)) for k in truth.id.tolist()
        ]
        self._frames.append(
            NoiseSamples(
                label=truth.label[j],
                detection=box_rows(objects)[i],
                truth=box_rows(truth)[j],
                velocity_error=_velocity_error(objects.velocity, i, truth.velocity_mps[j]),
                true_label=truth.label,
                true_object=np.array(numbers, np.int64),
                true_stamp_ns=np.full(len(truth), truth.stamp_ns, np.int64),
                true_box=box_rows(truth),
            )
        )

    def samples(self) -> NoiseSamples:
        """Return everything collected so far.

        Raises:
            InputError: no frame was added.
        """
        if not self._frames:
            raise InputError("frames with detections and truth", 0, "at least one")
        names = [item.name for item in fields(NoiseSamples)]
        return NoiseSamples(*(np.concatenate([getattr(f, n) for f in self._frames]) for n in names))


def match_truth(objects: Boxes, truth: Truth) -> tuple[I64, I64]:
    """Return indices of detections and of the true boxes that they match, (P,) each.

    Within a class, one to one, most pairs first and then the least total distance of the centres
    (Hungarian), none beyond `MATCH_RADIUS_M`.
    """
    _, both = np.unique(np.concatenate([objects.label, truth.label]), return_inverse=True)
    groups = (both[: len(objects)], both[len(objects) :])
    left, right = objects.centre_m[:, :2], truth.centre_m[:, :2]
    pairs = candidate_pairs(left, right, np.full(len(right), MATCH_RADIUS_M), groups)
    distance = centre_distance_m(left, right, pairs)
    near = distance < MATCH_RADIUS_M
    pairs = (pairs[0][near], pairs[1][near])
    chosen = hungarian(distance[near], pairs)
    return pairs[0][chosen], pairs[1][chosen]


def box_rows(boxes: Boxes) -> F64:
    """Return rows (N, 7) of x, y, z, yaw, l, w, h."""
    return np.column_stack([boxes.centre_m, boxes.yaw_rad, boxes.size_m])


def _velocity_error(measured: VelocityMeasurement | None, rows: I64, true_mps: F64) -> F64:
    if measured is None:
        return np.full((len(rows), 2), np.nan)
    error = measured.mean_mps[rows] - true_mps
    return np.where(measured.valid[rows, None], error, np.nan)

"""Outlines and velocities of the boxes of a submission."""

from __future__ import annotations

import math

import numpy as np

from mottrack.core.arrays import F64
from mottrack.eval.nuscenes.boxes import Bodies, BoxTable
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.submission import Submission
from mottrack.eval.nuscenes.submission_checks import VECTORS
from mottrack.formats.rigid import quaternion_yaws


def to_bodies(submission: Submission, boxes: BoxTable, rules: Rules) -> Bodies:
    """Return outlines and velocities of the boxes that `to_boxes` made of the submission.

    A velocity that is no number (NaN, null) is unknown.
    """
    listed = [box for given in submission.results.values() for box in given]
    vectors = [
        np.array([box[name] for box in listed], np.float64).reshape(-1, length)
        for name, length in VECTORS.items()
    ]
    velocities = [
        [value if isinstance(value, int | float) else math.nan for value in box["velocity"]]
        for box in listed
    ]
    velocity_mps = np.array(velocities, np.float64).reshape(-1, 2)
    return sorted_bodies(boxes, seen_from_above(*vectors), velocity_mps, rules)


def seen_from_above(centre_m: F64, size_m: F64, rotation: F64) -> F64:
    """Return (N, 5) centre x, y, length, width, heading of boxes as the format has them.

    Args:
        centre_m: (N, 3).
        size_m: (N, 3) width, length, height.
        rotation: (N, 4) quaternion w, x, y, z.
    """
    return np.column_stack([centre_m[:, :2], size_m[:, [1, 0]], quaternion_yaws(rotation)])


def sorted_bodies(boxes: BoxTable, bev: F64, velocity_mps: F64, rules: Rules) -> Bodies:
    """Return bodies in order of their sample, those of a sample in the order of the file."""
    order = np.argsort(boxes.sample, kind="stable")
    return Bodies(
        sample=boxes.sample[order],
        bev=bev[order],
        velocity_mps=velocity_mps[order],
        label=boxes.label[order].astype(np.int64),
        names=np.array(rules.classes, np.str_),
    )

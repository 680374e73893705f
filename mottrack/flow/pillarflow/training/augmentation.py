"""Augmentation: box scaling (paper, section IV-B) and errors of sensors.

The rotations and flips of IV-B are drawn in `crop`, which turns the visibility rasters with the
points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from mottrack.core.arrays import F32
from mottrack.flow.pillarflow.training.config import AugmentationConfig
from mottrack.flow.pillarflow.training.examples import Example


def augment(example: Example, config: AugmentationConfig, rng: Generator) -> Example:
    """Apply all changes but the rotation."""
    example = scale_objects(example, config.box_scale, rng)
    if rng.random() < config.thinned_share:
        kept = rng.uniform(config.min_kept_share, 1.0)
        then, now = (rng.random(len(p)) < kept for p in (example.previous, example.current))
        example = example.select(then, now)
        example = example.select_older(rng.random(len(example.older)) < kept)
    height_m = np.float32(rng.normal(0.0, config.height_noise_m))
    sweeps = current, previous, older = tuple(
        points.copy() for points in (example.current, example.previous, example.older)
    )
    previous[:] = _perturbed(previous, config, rng)
    for points in sweeps:
        points[:, 2] += height_m
    _change_reflectance(sweeps, config, rng)
    for slot in range(len(example.older_age_s)):
        on = example.older_slot == slot
        older[on] = _perturbed(older[on], config, rng)
    return replace(example, current=current, previous=previous, older=older)


def scale_objects(example: Example, amount: float, rng: Generator) -> Example:
    """Scale each object about its own centre in all sweeps, its rigid motion kept exact.

    With c the displacement of the centre and s the scale, the displacement m of a point becomes
    c + s (m - c).
    """
    count = len(example.centre_m)
    if not count or not amount:
        return example
    scale = rng.uniform(1.0 - amount, 1.0 + amount, count).astype(np.float32)
    previous, current, older = (
        points.copy() for points in (example.previous, example.current, example.older)
    )
    in_older = example.older_slot.astype(np.int64) + 2
    for points, rows, column in (
        (previous, example.previous_object, np.zeros(len(previous), np.int64)),
        (current, example.current_object, np.ones(len(current), np.int64)),
        (older, example.older_object, in_older),
    ):
        on = rows >= 0
        pivot, factor = example.centre_m[rows[on], column[on]], scale[rows[on]]
        points[on, :2] = pivot + factor[:, None] * (points[on, :2] - pivot)
        points[on, 2] *= factor
    motion = example.motion_m.copy()
    on = example.current_object >= 0
    rows = example.current_object[on]
    of_centre = example.centre_m[rows, 1] - example.centre_m[rows, 0]
    motion[on] = of_centre + scale[rows, None] * (motion[on] - of_centre)
    return replace(example, previous=previous, current=current, older=older, motion_m=motion)


def _perturbed(points: F32, config: AugmentationConfig, rng: Generator) -> F32:
    """Return points (N,4) with a small error of the odometry between the sweeps."""
    angle = rng.normal(0.0, config.pose_noise_rad)
    # cos and sin to first order: the angle is a few milliradians at most
    rotated = points[:, :2] @ np.array([[1.0, angle], [-angle, 1.0]], np.float32)
    moved = rotated + rng.normal(0.0, config.pose_noise_m, 2).astype(np.float32)
    return np.column_stack((moved, points[:, 2:]))


def _change_reflectance(
    sweeps: tuple[F32, ...], config: AugmentationConfig, rng: Generator
) -> None:
    """Apply another sensor's reflectance curve, or none at all, in place."""
    power = np.exp(rng.uniform(-config.gamma, config.gamma))
    bare = rng.random() < config.no_reflectance_share
    for points in sweeps:
        points[:, 3] = 0.0 if bare else points[:, 3] ** power

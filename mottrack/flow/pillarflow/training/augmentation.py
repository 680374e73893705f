"""Augmentation: rotation, flips, box scaling (paper, section IV-B) and faults of sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32
from mottrack.flow.pillarflow.training.example import Example


class AugmentationConfig(StrictModel):
    """How far training examples are changed."""

    rotate: bool = Field(True, description="turn the world about the vehicle, flip it")
    box_scale: float = Field(0.15, ge=0, lt=1, description="objects grow or shrink by up to this")
    thin_share: float = Field(0.2, ge=0, le=1, description="share of examples that lose points")
    thin_keep: float = Field(0.3, gt=0, le=1, description="least part of the points kept then")
    pose_noise_m: float = Field(0.015, ge=0, description="standard deviation of residual odometry")
    pose_noise_rad: float = Field(0.0006, ge=0, description="the same of the heading")
    height_noise_m: float = Field(0.05, ge=0, description="offset of the ground, of both sweeps")
    blind_share: float = Field(0.1, ge=0, le=1, description="share without visibility")
    dark_share: float = Field(0.3, ge=0, le=1, description="share without reflectance")
    gamma: float = Field(0.7, ge=0, description="reflectance ** exp(u), |u| up to this")


def augmented(example: Example, config: AugmentationConfig, rng: Generator) -> Example:
    """Everything but the turning, which `crop` does with the raster."""
    example = scaled_objects(example, config.box_scale, rng)
    if rng.random() < config.thin_share:
        example = thinned(example, rng.uniform(config.thin_keep, 1.0), rng)
    height_m = np.float32(rng.normal(0.0, config.height_noise_m))
    current = _raised(example.current, height_m)
    previous = _raised(_nudged(example.previous, config, rng), height_m)
    _relight(current, previous, config, rng)
    return replace(example, current=current, previous=previous)


def scaled_objects(example: Example, amount: float, rng: Generator) -> Example:
    """Scale each object about its own centre in both sweeps, its rigid motion kept exact.

    With c the way of the centre and s the scale, the motion m of a point becomes c + s (m - c).
    """
    count = len(example.centre_m)
    if not count or not amount:
        return example
    scale = rng.uniform(1.0 - amount, 1.0 + amount, count).astype(np.float32)
    previous, current, motion = (
        a.copy() for a in (example.previous, example.current, example.motion_m)
    )
    on_then, on_now = example.previous_object >= 0, example.current_object >= 0
    rows_then, rows_now = example.previous_object[on_then], example.current_object[on_now]
    for points, on, rows, side in (
        (previous, on_then, rows_then, 0),
        (current, on_now, rows_now, 1),
    ):
        pivot = example.centre_m[rows, side]
        points[on, :2] = pivot + scale[rows, None] * (points[on, :2] - pivot)
        points[on, 2] *= scale[rows]
    way = example.centre_m[rows_now, 1] - example.centre_m[rows_now, 0]
    motion[on_now] = way + scale[rows_now, None] * (motion[on_now] - way)
    return replace(example, previous=previous, current=current, motion_m=motion)


def thinned(example: Example, keep: float, rng: Generator) -> Example:
    """Drop points of both sweeps at random."""
    then = rng.random(len(example.previous)) < keep
    now = rng.random(len(example.current)) < keep
    return replace(
        example,
        previous=example.previous[then],
        previous_object=example.previous_object[then],
        current=example.current[now],
        current_object=example.current_object[now],
        motion_m=example.motion_m[now],
    )


def _raised(points: F32, height_m: np.float32) -> F32:
    points = points.copy()
    points[:, 2] += height_m
    return points


def _nudged(points: F32, config: AugmentationConfig, rng: Generator) -> F32:
    """A small error of the odometry between the sweeps."""
    points = points.copy()
    angle = rng.normal(0.0, config.pose_noise_rad)
    turned = points[:, :2] @ np.array([[1.0, angle], [-angle, 1.0]], np.float32)
    points[:, :2] = turned + rng.normal(0.0, config.pose_noise_m, 2).astype(np.float32)
    return points


def _relight(current: F32, previous: F32, config: AugmentationConfig, rng: Generator) -> None:
    """Another sensor's reflectance curve, or none at all (the arrays are the caller's own)."""
    power = np.exp(rng.uniform(-config.gamma, config.gamma))
    for points in (current, previous):
        points[:, 3] = points[:, 3] ** power
    if rng.random() < config.dark_share:
        current[:, 3] = 0.0
        previous[:, 3] = 0.0

"""Time steps, the vehicle's poses, and headings against motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.concerns import Concern
from mottrack.datasets.plausibility.seen import SeenScene
from mottrack.formats.checks import MIN_UPRIGHT_COSINE

SHORTEST_STEP_S, LONGEST_STEP_S = 0.002, 20.0
"""LiDARs turn at 5 to 50 Hz, labels come at 1 Hz at the least: beyond, the unit is another one."""
GAP_STEPS, SHORTEST_GAP_S = 5.0, 1.0
"""A gap is longer than so many usual steps, and than a second."""
MAX_SPEED_MPS = 70.0
"""250 km/h: faster vehicles and objects are errors of a pose, a stamp or an identity."""
MOVING_MPS = 2.0
"""Slower, the direction of a motion is mostly noise."""
FEWEST = 20
"""Boxes or steps below which shares say nothing."""
OPPOSED = -0.7
"""Cosine of 135 degrees: more than that from its heading, a vehicle moves backwards."""
WALKING = ("pedestrian", "person", "animal")
"""Labels (or parts of them) of what turns on the spot and walks sideways."""


def motion_concerns(scene: SeenScene) -> Iterator[Concern]:
    """Yield what is unlikely in the times, poses and headings of a scene of two frames or more."""
    step_s = np.diff(scene.stamp_ns) * 1e-9
    typical_s = float(np.median(step_s))
    every = np.ones(len(step_s), dtype=bool)
    frame = np.arange(len(step_s), dtype=np.int64) + 1
    if not SHORTEST_STEP_S <= typical_s <= LONGEST_STEP_S:
        text = f"the median is {typical_s:.3g} s (are the stamps in nanoseconds?)"
        yield from scene.concern("time steps that no sensor has", every, frame, text)
    gap = step_s > max(GAP_STEPS * typical_s, SHORTEST_GAP_S)
    yield from scene.concern("gaps in time", gap, frame, f"usual step {typical_s:.3g} s")
    yield from _vehicle(scene, step_s, frame)
    yield from _headings(scene)


def _vehicle(scene: SeenScene, step_s: F64, frame: I64) -> Iterator[Concern]:
    lying = scene.poses[:, 2, 2] < MIN_UPRIGHT_COSINE
    text = "the ego frame's z axis does not point up"
    yield from scene.concern("poses of a vehicle that lies", lying, np.arange(len(lying)), text)
    moved = np.diff(scene.poses[:, :3, 3], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = moved / step_s[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    jumps = speed > MAX_SPEED_MPS
    yield from scene.concern("jumps of the vehicle", jumps, frame, f"over {MAX_SPEED_MPS:g} m/s")
    driving = (speed > MOVING_MPS) & ~jumps
    along = np.einsum("ni,ni->n", scene.poses[1:, :3, 0], velocity) / np.maximum(speed, 1e-9)
    backwards = driving & (along < OPPOSED)
    if backwards.sum() > max(FEWEST, driving.sum()) / 2:
        text = "x is forward (are the poses in reverse order, or inverted?)"
        kind = "steps in which the vehicle drives backwards"
        yield from scene.concern(kind, backwards, frame, text)


def _headings(scene: SeenScene) -> Iterator[Concern]:
    truth, velocity = scene.truth.boxes, scene.truth.velocity_mps
    speed = np.hypot(*velocity.T)
    jumps = speed > MAX_SPEED_MPS
    text = f"over {MAX_SPEED_MPS:g} m/s between annotations"
    yield from scene.concern("jumps of an object", jumps, truth.frame, text)
    walks = np.array([any(word in label for word in WALKING) for label in truth.label], dtype=bool)
    moving = (speed > MOVING_MPS) & ~jumps & ~walks
    heading = np.column_stack([np.cos(truth.yaw_rad), np.sin(truth.yaw_rad)])
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.einsum("ni,ni->n", heading, velocity) / speed
    for kind, wrong in (
        ("headings against the motion", moving & (cosine < OPPOSED)),
        ("headings across the motion", moving & (np.abs(cosine) < -OPPOSED)),
    ):
        if moving.sum() >= FEWEST and wrong.sum() > moving.sum() / 2:
            text = f"of {moving.sum()} moving boxes (another zero or sense of the angle?)"
            yield from scene.concern(kind, wrong, truth.frame, text)
    yaw = scene.found.yaw_rad
    if len(yaw) >= FEWEST and np.ptp(yaw) < 1e-9:  # not even noise
        same = np.ones(len(yaw), dtype=bool)
        text = f"all {yaw[0]:.3f} rad in the world (is the quaternion x, y, z, w?)"
        kind = f"{scene.found_name} of one heading"
        yield from scene.concern(kind, same, scene.found.frame, text)

"""Conversion of plain arrays to sweeps and detections."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from mottrack.core.arrays import F32
from mottrack.core.checks import as_array, require_instance
from mottrack.core.errors import InputError, unknown_name
from mottrack.core.objects import Objects
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep

Detections = Objects | Mapping[str, ArrayLike]
NEEDED = ("frame", "centre_m", "size_m", "yaw_rad", "label", "score")
KNOWN = tuple(f.name for f in fields(Objects) if f.name != "stamp_ns")


def pose_of(world_T_ego: Pose | ArrayLike) -> Pose:
    """Return the pose, or make one from a (4, 4) or (3, 4) matrix."""
    return world_T_ego if isinstance(world_T_ego, Pose) else Pose.from_matrix(world_T_ego)


def sweep_of(
    points: ArrayLike, stamp_ns: int, world_T_ego: Pose, origin_m: ArrayLike = (0.0, 0.0, 0.0)
) -> Sweep:
    """Make a sweep from (N, 3) x, y, z or (N, 4) x, y, z, reflectance; ego frame, metres.

    The arrays are copied: a driver may reuse its buffer for the next sweep.

    Raises:
        InputError: the shape is another, a number is not finite, reflectance outside [0, 1].
    """
    array = _array_of(points)
    return Sweep(
        xyz_m=np.array(array[:, :3], order="C"),
        reflectance=np.array(array[:, 3])
        if array.shape[1] == 4
        else np.zeros(len(array), np.float32),
        stamp_ns=stamp_ns,
        world_T_ego=world_T_ego,
        origin_m=np.array(origin_m, dtype=np.float64),
    )


def _array_of(points: ArrayLike) -> F32:
    """Return (N, 3) or (N, 4) numbers; an empty list is no points.

    Raises:
        InputError: text, ragged rows, masked or complex numbers, or another shape.
    """
    if isinstance(points, Sized) and not len(points):
        return np.zeros((0, 3), np.float32)
    array: F32 = as_array("points", points, np.float32, (None, None))
    if array.shape[1] not in (3, 4):
        raise InputError("shape of points", array.shape, "(N, 3) or (N, 4)")
    return array


def detections_of(detections: Detections, stamp_ns: int, world_T_ego: Pose) -> Objects:
    """Make detections in the world frame from `Objects`, or from arrays by the names of its fields.

    ``frame`` says "ego" or "world" and has no default: frames are mixed up too easily.

    Raises:
        InputError: an array is missing or misshapen, or the stamp is another.
        ConfigError: a name is unknown.
    """
    objects = detections if isinstance(detections, Objects) else _objects(detections, stamp_ns)
    if objects.stamp_ns != stamp_ns:
        raise InputError(
            "stamp_ns of detections", objects.stamp_ns, f"that of the step, {stamp_ns}"
        )
    return objects if objects.frame == "world" else objects.transformed(world_T_ego, "world")


def _objects(arrays: Mapping[str, ArrayLike], stamp_ns: int) -> Objects:
    require_instance("detections", arrays, Mapping)
    for name in arrays:
        if name not in KNOWN:
            raise unknown_name("array of detections", name, KNOWN)
    missing = [name for name in NEEDED if name not in arrays]
    if missing:
        raise InputError("detections", f"without {', '.join(missing)}", ", ".join(NEEDED))
    return Objects(stamp_ns=stamp_ns, **dict(arrays))  # type: ignore[arg-type]

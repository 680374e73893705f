"""The check of one scene."""

from __future__ import annotations

import numpy as np

from mottrack.core import Frame, MottrackError, Scene, Sweep
from mottrack.core.sweep import seconds_between
from mottrack.datasets.check.findings import SceneCheck

MAX_SPEED_MPS = 70.0
"""Faster vehicles and objects are errors of a pose, a stamp or an identity."""
MIN_POINTS = 100


def check_scene(scene: Scene, every: int) -> SceneCheck:
    """Look at every frame, and read every `every`-th sweep."""
    check = SceneCheck(scene.name)
    check.counts["frames"] = len(scene)
    previous: Frame | None = None
    for index in range(len(scene)):
        frame = _frame(scene, index, check)
        if frame is not None:
            _check_frame(check, frame, previous)
            previous = frame
        if index % every == 0:
            _check_sweep(check, scene, index, frame)
    return check


def _frame(scene: Scene, index: int, check: SceneCheck) -> Frame | None:
    try:
        return scene.frame(index)
    except MottrackError as error:
        check.add_error(error)
        return None


def _check_frame(check: SceneCheck, frame: Frame, previous: Frame | None) -> None:
    check.counts["key frames"] += frame.is_key
    for name, boxes in (("true boxes", frame.truth), ("detections", frame.detections)):
        if boxes is not None:
            check.counts[name] += len(boxes)
    _check_identities(check, frame)
    if previous is not None:
        _check_step(check, previous, frame)


def _check_identities(check: SceneCheck, frame: Frame) -> None:
    if frame.truth is not None and len(np.unique(frame.truth.id)) != len(frame.truth):
        check.add("out of order", f"frame {frame.stamp_ns}: an identity twice in the truth")


def _check_step(check: SceneCheck, previous: Frame, frame: Frame) -> None:
    elapsed_s = seconds_between(previous.stamp_ns, frame.stamp_ns)
    if elapsed_s <= 0.0:
        text = f"frame {frame.stamp_ns} comes after {previous.stamp_ns}"
        check.add("out of order", text)
        return
    moved = frame.world_T_ego.translation_m - previous.world_T_ego.translation_m
    speed = float(np.linalg.norm(moved)) / elapsed_s
    if speed > MAX_SPEED_MPS:
        check.add("jump", f"frame {frame.stamp_ns}: the vehicle moves at {speed:.0f} m/s")
    if frame.truth is not None:
        fast = np.hypot(*frame.truth.velocity_mps.T) > MAX_SPEED_MPS
        for identity in frame.truth.id[fast].tolist():
            check.add("jump", f"frame {frame.stamp_ns}: object {identity} jumps")


def _check_sweep(check: SceneCheck, scene: Scene, index: int, frame: Frame | None) -> None:
    try:
        sweep = scene.sweep(index)
    except MottrackError as error:
        check.add_error(error)
        return
    check.counts["sweeps read"] += 1
    check.counts["points"] += len(sweep)
    _check_points(check, sweep, frame)


def _check_points(check: SceneCheck, sweep: Sweep, frame: Frame | None) -> None:
    if len(sweep) < MIN_POINTS:
        check.add("truncated", f"sweep {sweep.stamp_ns}: {len(sweep)} points")
    if frame is not None and frame.stamp_ns != sweep.stamp_ns:
        check.add("out of order", f"sweep {sweep.stamp_ns} at frame {frame.stamp_ns}")

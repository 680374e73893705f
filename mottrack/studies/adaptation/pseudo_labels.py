"""Labels of a log without labels: registration over several baselines, where it agrees with itself.

A cell has four estimates of its velocity: registration to the sweeps 0.1, 0.2 and 0.3 s before, and
that of the pair over 0.2 s measured backwards, looked up where the cell came from. Where three of
them agree, their mean is its label: at rest or moving. Everything else is masked: a wrong label
costs more than a missing one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F32, F64, I16, Mask
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, Scene
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.pillarflow.training.examples import LabelledPair, Labels
from mottrack.flow.registration.components import Similar, moving_cells
from mottrack.pipeline.mirrored import mirrored_sweep
from mottrack.studies.adaptation.stretches import earlier_sweep

LABEL_GRID = BevGrid(cell_m=0.5)
"""Cells of the labels: those of the network."""
BASELINES_S = (0.1, 0.2, 0.3)
"""The network sees a pair over one of the first two, as in its training; the others show what it
can't."""
_BACKWARDS = 1
"""Row of `BASELINES_S` whose pair is measured in both directions."""
_VOTES = 3
"""Of four estimates that must agree: two can share a fault, such as a wrong twin of a pole."""
_TOLERANCE_MPS, _TOLERANCE_SHARE = 0.4, 0.15
"""Estimates this near agree: the noise of a registration over 0.1 s, and an acceleration of 3 m/s²
over the difference of the baselines at 6 m/s."""
_SIMILAR = Similar(1.0, 0.35)
"""Velocity step inside one object, as in the refinement."""


@dataclass(frozen=True)
class Coverage:
    """How many of the occupied cells of some frames got a label."""

    cells: int = 0
    moving: int = 0
    static: int = 0

    def __add__(self, other: Coverage) -> Coverage:
        """Return both together."""
        return Coverage(
            self.cells + other.cells, self.moving + other.moving, self.static + other.static
        )


@dataclass(frozen=True)
class LabelledFrame:
    """A pair with labels made by registration."""

    pair: LabelledPair
    coverage: Coverage


def label_frame(
    scene: Scene, index: int, teacher: FlowSource, seen: int = 0
) -> LabelledFrame | None:
    """Return a frame's pair with its labels; None where an earlier sweep is missing.

    Args:
        scene: with sweeps.
        index: of the frame.
        teacher: a source on `LABEL_GRID`.
        seen: which of `BASELINES_S` is that of the pair.
    """
    past = [earlier_sweep(scene, index, age_s) for age_s in BASELINES_S]
    sweeps = [sweep for sweep in past if sweep is not None]
    if len(sweeps) < len(BASELINES_S):
        return None
    current = scene.sweep(index)
    fields = [_estimate(teacher, sweep, current) for sweep in sweeps]
    occupied = fields[0].occupied
    known = [_known(field) for field in fields]
    known.append(_backwards(teacher, sweeps[_BACKWARDS], current, fields[_BACKWARDS]))
    velocity_mps, agreed = agreement(np.stack([k[occupied] for k in known]))
    label_mps = np.zeros((*LABEL_GRID.shape, 2), np.float32)
    labelled = np.zeros(LABEL_GRID.shape, np.bool_)
    label_mps[occupied], labelled[occupied] = velocity_mps, agreed
    moving = labelled & (np.hypot(label_mps[..., 0], label_mps[..., 1]) > MOVING_MPS)
    label_mps[~moving] = 0.0
    labels = _labels(sweeps[seen], current, CellLabels(label_mps, labelled, moving))
    counts = (int(mask.sum()) for mask in (occupied, moving, labelled & ~moving))
    return LabelledFrame(LabelledPair(sweeps[seen], current, labels), Coverage(*counts))


def agreement(estimates_mps: F64) -> tuple[F64, Mask]:
    """Return the mean (C, 2) of the estimates that agree, and where at least three do (C,).

    Args:
        estimates_mps: (E, C, 2), NaN where one says nothing.
    """
    apart = np.linalg.norm(estimates_mps[:, None] - estimates_mps[None], axis=-1)
    speed = np.linalg.norm(estimates_mps, axis=-1)
    near = apart <= np.maximum(_TOLERANCE_MPS, _TOLERANCE_SHARE * speed)[:, None]
    votes = near.sum(axis=1)
    best = np.argmax(votes, axis=0)
    cells = np.arange(estimates_mps.shape[1])
    voters = near[best, :, cells].T[..., None]
    total = np.where(voters, np.nan_to_num(estimates_mps), 0.0).sum(axis=0)
    mean: F64 = total / np.maximum(voters.sum(axis=0), 1)
    return mean, votes[best, cells] >= _VOTES


@dataclass(frozen=True)
class CellLabels:
    """Labels of the cells of `LABEL_GRID`."""

    velocity_mps: F32
    """(H, W, 2)"""
    labelled: Mask
    """(H, W)"""
    moving: Mask
    """(H, W) a part of the labelled ones."""


def _estimate(teacher: FlowSource, previous: Sweep, current: Sweep) -> FlowField:
    teacher.reset()
    return teacher.estimate((previous,), current)


def _known(field: FlowField) -> F64:
    """Return the velocities of a field (H, W, 2), NaN where it has none."""
    known = field.valid[..., None]
    return np.where(known, field.velocity_mps, np.nan).astype(np.float64)


def _backwards(teacher: FlowSource, previous: Sweep, current: Sweep, forwards: FlowField) -> F64:
    """Return the velocity (H, W, 2) by the reversed pair, where each cell came from."""
    about_ns = current.stamp_ns
    past, then = (mirrored_sweep(sweep, about_ns) for sweep in (current, previous))
    back = _estimate(teacher, past, then)
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    previous_T_current = previous.world_T_ego.inverse() @ current.world_T_ego
    came_from = forwards.grid.centres_m() - forwards.velocity_mps * elapsed_s
    flat = came_from.reshape(-1, 2)
    places = previous_T_current.apply(np.column_stack([flat, np.zeros(len(flat))]))
    rows, cols, inside = back.grid.cells(places)
    found = -back.velocity_mps[rows, cols] @ rotation_2d(previous_T_current.yaw_rad)
    known = inside & back.valid[rows, cols]
    return np.where(known[:, None], found, np.nan).reshape(*forwards.grid.shape, 2)


def _labels(previous: Sweep, current: Sweep, cells: CellLabels) -> Labels:
    """Return labels by point; what is not labelled lies on an object that was not seen before.

    Training masks the cells of such an object.
    """
    objects, count = moving_cells(cells.velocity_mps, cells.moving, _SIMILAR)
    object_of = np.where(cells.labelled, objects, count)
    rows, cols, inside = LABEL_GRID.cells(current.xyz_m)
    current_object = np.where(inside, object_of[rows, cols], count).astype(np.int16)
    velocity_mps = np.where(inside[:, None], cells.velocity_mps[rows, cols], 0.0)
    elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
    then_m = current.xyz_m[:, :2] - velocity_mps * elapsed_s
    centre_m = np.zeros((count + 1, 2, 2), np.float32)
    for k in np.unique(current_object[(current_object >= 0) & (current_object < count)]):
        on = current_object == k
        centre_m[k] = then_m[on].mean(axis=0), current.xyz_m[on, :2].mean(axis=0)
    moved = (current_object >= 0) & (current_object < count)
    seen = previous.seen_from(current)
    previous_object = _objects_before(seen, then_m[moved], current_object[moved])
    return Labels(previous_object, current_object, velocity_mps.astype(np.float32), centre_m)


def _objects_before(previous: Sweep, then_m: F64, object_of: I16) -> I16:
    """Return the object of each previous point: that whose moved points share its cell."""
    owner = np.full(LABEL_GRID.shape, -1, np.int16)
    rows, cols, inside = LABEL_GRID.cells(then_m)
    owner[rows[inside], cols[inside]] = object_of[inside]
    rows, cols, inside = LABEL_GRID.cells(previous.xyz_m)
    return np.where(inside, owner[rows, cols], -1).astype(np.int16)

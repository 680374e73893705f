"""Samples of estimated and true flow, cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.frame import Frame
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.core.objects import Truth
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.core.tables import FlowSamples
from mottrack.experiment.settings import Settings
from mottrack.flow.ground_truth import RIM_M, GroundTruthFlow
from mottrack.lidar.in_boxes import PointsInBoxes, near_boxes, points_in_boxes
from mottrack.pipeline.stream import Pair, Step

MARGIN_M = 0.15
"""Boxes grow by this: labels are tight, and their position is off by a few centimetres."""
FEWEST_POINTS = 5
"""Of an observable object: fewer returns are not enough for any method to match."""
TRUTH_FRAMES = 12
"""Recent frames whose truth is kept: 0.6 s at 20 Hz, more than the longest `pair_s` (0.5 s)."""


class _Cells(NamedTuple):
    """What the cells of a grid lie on."""

    observable: Mask
    """(H, W) whether the cell's object, if any, was hit often enough in both sweeps."""
    movable: Mask
    """(H, W) whether the cell lies on an object of a tracked class."""


@dataclass
class FlowSampler:
    """Compares fields with the truth that ``GroundTruthFlow`` makes of annotated tracks.

    A cell is observable when the object in it was hit at least `FEWEST_POINTS` times in both
    sweeps, or when no object is in it: no method can match an object that was hit in one sweep.
    """

    truth_flow: GroundTruthFlow
    classes: tuple[str, ...]
    """Of the objects that are tracked: their cells are movable."""
    limit: int
    enabled: bool
    _parts: list[FlowSamples] = field(default_factory=list)
    _truth: dict[int, Truth] = field(default_factory=dict)

    @classmethod
    def of(cls, settings: Settings, classes: Sequence[str], *, has_sweeps: bool) -> FlowSampler:
        """Make a sampler for one scene; disabled where the experiment wants no flow scores."""
        truth_flow = GroundTruthFlow(grid=settings.grid.grid())
        enabled = settings.score_flow and has_sweeps
        return cls(truth_flow, tuple(classes), settings.flow_sample_limit, enabled)

    def observe(self, frame: Frame) -> None:
        """Receive the truth of every frame, in order."""
        self.truth_flow.observe(frame)
        if frame.truth is not None:
            self._truth = dict(
                [*self._truth.items(), (frame.stamp_ns, frame.truth)][-TRUTH_FRAMES:]
            )

    def collect(self, frame: Frame, step: Step, key_index: int) -> None:
        """Keep the cells of one field whose truth is known.

        Args:
            frame: the current frame.
            step: the pipeline's results for it.
            key_index: row of the frame in the scene's FrameTable.
        """
        field, pair = step.field, step.pair
        if not self.enabled or field is None or pair is None or frame.truth is None:
            return
        true_field = self.truth_flow.estimate(pair.past, pair.current)
        known = field.occupied & true_field.valid
        if frame.labelled_azimuth_rad is not None:
            known &= _between(field.grid.centres_m(), frame.labelled_azimuth_rad)
        known &= ~_rim(true_field, frame, known)
        rows, columns = _at_most(np.nonzero(known), self.limit)
        true_mps = true_field.velocity_mps[rows, columns]
        cells = self._cells(field, frame.truth, pair)
        self._parts.append(
            FlowSamples(
                frame=np.full(len(rows), key_index),
                xy_m=field.grid.centres_m()[rows, columns].astype(np.float32),
                estimate_mps=field.velocity_mps[rows, columns],
                truth_mps=true_mps,
                dt_s=np.full(
                    len(rows), seconds_between(pair.previous.stamp_ns, pair.current.stamp_ns)
                ),
                valid=field.valid[rows, columns],
                dynamic=np.hypot(true_mps[:, 0], true_mps[:, 1]) > MOVING_MPS,
                movable=cells.movable[rows, columns],
                observable=cells.observable[rows, columns],
            )
        )

    def samples(self) -> FlowSamples:
        """Return everything collected, in order of time."""
        return FlowSamples.stacked(self._parts)

    def _cells(self, field: FlowField, truth: Truth, pair: Pair) -> _Cells:
        """Return what the cells lie on; an object counts where it was hit."""
        inside = _hits(pair.current, truth)
        seen = np.diff(inside.start) >= FEWEST_POINTS
        before = self._truth.get(pair.previous.stamp_ns)
        if before is not None:
            seen_before = np.diff(_hits(pair.previous, before).start) >= FEWEST_POINTS
            seen &= np.isin(truth.id, before.id[seen_before])
        object_of = inside.first_box(len(pair.current))
        rows, columns, in_grid = field.grid.cells(pair.current.xyz_m)
        unseen = in_grid & (object_of >= 0) & ~np.append(seen, True)[object_of]
        observable = np.ones(field.grid.shape, dtype=np.bool_)
        observable[rows[unseen], columns[unseen]] = False
        tracked = np.append(np.isin(truth.label, self.classes), False)[object_of]
        movable = np.zeros(field.grid.shape, dtype=np.bool_)
        movable[rows[in_grid & tracked], columns[in_grid & tracked]] = True
        return _Cells(observable, movable)


def _between(xy_m: F64, azimuth_rad: tuple[float, float]) -> Mask:
    right, left = azimuth_rad
    azimuth = np.arctan2(xy_m[..., 1], xy_m[..., 0])
    return (azimuth >= right) & (azimuth <= left)


def _rim(true_field: FlowField, frame: Frame, known: Mask) -> Mask:
    """Return (H, W) the known cells at rest beside a moving box, which may hold its points."""
    rim = np.zeros(true_field.grid.shape, np.bool_)
    if frame.truth is None:
        return rim
    speed_mps = np.hypot(true_field.velocity_mps[..., 0], true_field.velocity_mps[..., 1])
    rows, columns = np.nonzero(known & (speed_mps <= MOVING_MPS))
    boxes = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
    moving = boxes.select(np.hypot(*boxes.velocity_mps.T) > MOVING_MPS)
    rim[rows, columns] = near_boxes(true_field.grid.centres_m()[rows, columns], moving, RIM_M)
    return rim


def _hits(sweep: Sweep, truth: Truth) -> PointsInBoxes:
    boxes = truth.transformed(sweep.world_T_ego.inverse(), "ego")
    return points_in_boxes(sweep.xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, MARGIN_M)


def _at_most(cells: tuple[I64, ...], limit: int) -> tuple[I64, I64]:
    """Return rows and columns, evenly thinned to at most ``limit``."""
    n = len(cells[0])
    index = np.arange(n) if n <= limit else np.linspace(0, n - 1, limit).astype(np.int64)
    return cells[0][index], cells[1][index]

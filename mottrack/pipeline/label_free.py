"""What geometry says of a flow field without labels: see `eval.label_free` for the figures.

The obstacle points of a sweep form components. An EARLIER sweep, `CHECK_S` old, decides about each,
whatever a source claims: a component of which a tenth stands where the earlier sweep saw through
moved; one of which it saw most points in place rested. The age is three times that of the pair that
flow is measured from: a pedestrian moves by the length of an arm, and a velocity that is off by
1 m/s leaves 0.3 m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.core.pose import rotation_2d
from mottrack.eval.flow_error import GROSS_MPS
from mottrack.eval.label_free import LabelFreeSums
from mottrack.flow.registration.components import connected_cells
from mottrack.flow.sweep_pair import SweepPair
from mottrack.lidar.distances import truncated_distances
from mottrack.lidar.point_grid import PointGrid, build_point_grid
from mottrack.lidar.visibility import FREE, UNSEEN, RangeImage, queried_from, states_of
from mottrack.pipeline.scene_flow import cell_velocities

CHECK_S = 0.3
"""Wanted age of the earlier sweep: at 0.5 s what turns or brakes no longer fits its velocity."""
CHECK_GRID = BevGrid(cell_m=0.5)
"""Components are connected cells of this grid, and points beyond it are not judged."""
_FAR_M = 25.0
"""Beyond, cells are linked across an empty one: rays are further apart."""
_VOXEL_M = 0.1
"""One point per cube is compared; the distance of two samples of one surface is below it."""
_TOLERANCE_M = 0.5
"""How far before the returns around it a point must lie to be in free space."""
_Z_SCALE = 0.5
"""Weight of heights in a distance: rings sample a wall at few of them, and others as the vehicle
drives on."""
_APART_M = 0.2
"""A point with a neighbour this near in the earlier sweep is no evidence of motion."""
_NEAR_M = 0.15
"""A point with one this near is explained by rest: a voxel and the noise of two ranges."""
_MOVED_SHARE, _FEWEST = 0.1, 5
"""Share and number of the visible points in free space that prove a motion: sampling at edges
puts a few of any surface there."""
_RESTED_SHARE = 0.5
"""Share of the visible points that rest must explain."""
_TRUNCATION_M = 0.5
"""Of distances between sweeps: farther off there is no counterpart."""
_LONGEST_M = 2.0
"""Of the remaining displacement of what moved: beyond, its counterpart is another object."""


@dataclass(frozen=True)
class Evidence:
    """What an earlier sweep says of the current points, and what is needed to test a field."""

    xyz_m: F32
    """(N, 3) thinned obstacle points of the current sweep, current ego frame."""
    flat_m: F32
    """(N, 3) the same with heights scaled, for distances."""
    then_flat_m: F32
    """(M, 3) those of the earlier sweep, current ego frame, heights scaled."""
    earlier: PointGrid
    """The earlier points, heights scaled, indexed."""
    image: RangeImage
    """Of the earlier sweep, asked for places in the current ego frame."""
    elapsed_s: float
    """Age of the earlier sweep."""
    visible: Mask
    """(N,) points whose place the earlier sweep saw."""
    then_visible: Mask
    """(M,) earlier points whose place the current sweep sees."""
    apart: Mask
    """(N,) points in free space of the earlier sweep."""
    component: I64
    """(N,) component of each point, -1 beyond the grid."""
    moving: Mask
    """(N,) points of components that moved."""
    static: Mask
    """(N,) points of components at rest."""
    at_rest_m: float
    """Sum of the truncated distances of all visible points, of both sweeps, without flow."""

    @classmethod
    def of(cls, pair: SweepPair) -> Evidence:
        """Compare the current sweep of a pair with the newest sweep of its past."""
        now_m = pair.current.xyz_m[pair.current_features.thinned(_VOXEL_M)]
        then_m = pair.previous.xyz_m[pair.previous_features.thinned(_VOXEL_M)]
        image = queried_from(pair.previous_features.image, pair.previous_T_current)
        state = states_of(image, now_m, _TOLERANCE_M)
        then_state = states_of(pair.current_features.image, then_m, _TOLERANCE_M)
        flat = np.array([1.0, 1.0, _Z_SCALE], np.float32)
        now_flat_m, then_flat_m = now_m * flat, then_m * flat
        earlier, later = _index(then_flat_m), _index(now_flat_m)
        component, count = connected_cells(now_m, CHECK_GRID, _FAR_M)
        inside = component >= 0
        visible = inside & (state != UNSEEN)
        then_visible = CHECK_GRID.cells(then_m)[2] & (then_state != UNSEEN)
        rest_m = truncated_distances(earlier, now_flat_m, _TRUNCATION_M)
        then_rest_m = truncated_distances(later, then_flat_m, _TRUNCATION_M)
        apart = inside & (state == FREE) & (rest_m > _APART_M)
        seen, proof, placed = (
            np.bincount(component[mask], minlength=count)
            for mask in (visible, apart, visible & (rest_m < _NEAR_M))
        )
        moved = (proof >= _FEWEST) & (proof >= _MOVED_SHARE * seen)
        rested = (proof < _MOVED_SHARE * seen) & (placed > _RESTED_SHARE * seen)
        rested &= seen >= _FEWEST
        return cls(
            xyz_m=now_m,
            flat_m=now_flat_m,
            then_flat_m=then_flat_m,
            earlier=earlier,
            image=image,
            elapsed_s=pair.elapsed_s,
            visible=visible,
            then_visible=then_visible,
            apart=apart,
            component=component,
            # the last entry is picked by -1: beyond the grid
            moving=np.append(moved, False)[component],
            static=np.append(rested, False)[component] & visible,
            at_rest_m=float(rest_m[visible].sum() + then_rest_m[then_visible].sum()),
        )

    def claimed_mps(self, field: FlowField) -> F64:
        """Return (N, 2) the velocity of each point's cell, 0 where it was not measured."""
        return cell_velocities(field, self.xyz_m.astype(np.float64))

    def judge(self, field: FlowField) -> LabelFreeSums:
        """Return the residuals of a field at the current sweep."""
        claimed_mps = self.claimed_mps(field)
        moved_m = self.flat_m.copy()
        moved_m[:, :2] -= (claimed_mps * self.elapsed_s).astype(np.float32)
        forward_m = truncated_distances(self.earlier, moved_m, _TRUNCATION_M)[self.visible]
        backward_m = truncated_distances(_index(moved_m), self.then_flat_m, _TRUNCATION_M)
        square = (claimed_mps[self.static] ** 2).sum(axis=1)
        return LabelFreeSums(
            frames=1.0,
            seen=float(self.visible.sum() + self.then_visible.sum()),
            residual_m=float(forward_m.sum() + backward_m[self.then_visible].sum()),
            at_rest_m=self.at_rest_m,
            moving=float(self.moving.sum()),
            moving_m2ps2=self._remaining_m2ps2(moved_m),
            static=float(self.static.sum()),
            static_m2ps2=float(square.sum()),
            static_fast=float(np.count_nonzero(square > GROSS_MPS**2)),
        )

    def _remaining_m2ps2(self, flat_m: F32) -> float:
        """Return the squared remaining speed of moving components, summed over their points.

        Only the points in free space of the earlier sweep show it, where they are or where the flow
        puts them: the side of a car lies on itself however far it is moved along. Their mean stands
        for all points of the component.
        """
        owner, moved_m = self.component[self.moving], flat_m[self.moving]
        distance_m = truncated_distances(self.earlier, moved_m, _LONGEST_M)
        placed_m = moved_m * np.array([1.0, 1.0, 1.0 / _Z_SCALE], np.float32)
        misplaced = states_of(self.image, placed_m, _TOLERANCE_M) == FREE
        proof = self.apart[self.moving] | (misplaced & (distance_m > _APART_M))
        square = (np.maximum(distance_m[proof] - _VOXEL_M, 0.0) / self.elapsed_s) ** 2
        points = np.bincount(owner)
        proofs = np.bincount(owner[proof], minlength=len(points))
        sums = np.bincount(owner[proof], square, len(points))
        return float((sums / np.maximum(proofs, 1) * points).sum())


@dataclass(frozen=True)
class Reversal:
    """The same pair measured backwards: from the current sweep to the previous one."""

    field: FlowField
    """At the previous sweep, of a source that was fed with the current one as the past."""
    pair: SweepPair
    """The pair as it was measured forwards."""

    def agreement(self, evidence: Evidence, field: FlowField) -> LabelFreeSums:
        """Count the points of moving components whose two velocities are opposite."""
        xyz_m = evidence.xyz_m[evidence.moving].astype(np.float64)
        claimed_mps = evidence.claimed_mps(field)[evidence.moving]
        moved_m = xyz_m.copy()
        moved_m[:, :2] -= claimed_mps * self.pair.elapsed_s
        previous_T_current = self.pair.previous_T_current
        back_mps = cell_velocities(self.field, previous_T_current.apply(moved_m))
        back_mps = back_mps @ rotation_2d(previous_T_current.yaw_rad)
        apart_mps = np.hypot(*(claimed_mps + back_mps).T)
        agrees = (np.hypot(*claimed_mps.T) > MOVING_MPS) & (apart_mps < GROSS_MPS)
        return LabelFreeSums(reversed=float(len(xyz_m)), agreeing=float(agrees.sum()))


def _index(xyz_m: F32) -> PointGrid:
    return build_point_grid(xyz_m, _TRUNCATION_M / 2)

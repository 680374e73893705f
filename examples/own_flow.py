"""A flow source of your own: a class with `estimate`.

PYTHONPATH=examples mottrack run demo flow=own_flow:BlobFlow flow.reach_m=4 --out out/own
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from mottrack import BevGrid, FlowField, Sweep
from mottrack.core import FlowSourceBase
from mottrack.core.sweep import seconds_between


class BlobFlow(FlowSourceBase):
    """Each connected blob of occupied cells is matched to the nearest blob of the sweep before."""

    def __init__(self, reach_m: float = 3.0, *, grid: BevGrid) -> None:  # flow.reach_m, grid.*
        self.grid, self.reach_m = grid, reach_m

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Velocity of every cell (H, W) over the ground, m/s, in the current ego frame."""
        previous = past[-1]
        then_m = self._blobs(previous.seen_from(current))[1][1:]  # ego motion removed
        label, now_m = self._blobs(current)
        elapsed_s = seconds_between(previous.stamp_ns, current.stamp_ns)
        apart_m, nearest = cKDTree(then_m).query(now_m, distance_upper_bound=self.reach_m)
        found = np.isfinite(apart_m)  # blobs beyond reach, and the background, have no velocity
        shift_m = now_m - np.vstack([then_m, np.zeros(2)])[nearest]
        velocity_mps = np.where(found[:, None], shift_m / elapsed_s, 0.0)
        return replace(
            FlowField.unmeasured(self.grid, label > 0, current.stamp_ns),
            velocity_mps=velocity_mps[label],
            covariance_m2ps2=np.broadcast_to(4.0 * np.eye(2), (*self.grid.shape, 2, 2)),
            valid=found[label],
        )

    def _blobs(self, sweep: Sweep) -> tuple[np.ndarray, np.ndarray]:
        occupied = self.grid.occupancy(sweep.xyz_m[sweep.xyz_m[:, 2] > 0.4])  # crude: flat ground
        label, n = ndimage.label(occupied, np.ones((3, 3)))
        row_col = ndimage.center_of_mass(occupied, label, np.arange(1, n + 1))
        col_row = np.array(row_col).reshape(-1, 2)[:, ::-1]
        xy_m = self.grid.x_min_m + (col_row + 0.5) * self.grid.cell_m
        return label, np.vstack([[1e6, 1e6], xy_m])  # blob 0 is the background: out of reach


if __name__ == "__main__":
    print(__doc__)  # it is loaded by name: the command is there

"""A tracker of your own: any class with `step`.

PYTHONPATH=examples mottrack compare demo tracker=kalman,own_tracker:NearestTracker --out out/own
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack import Objects, Tracks
from mottrack.core import InputError
from mottrack.core.sweep import seconds_between


class NearestTracker:
    """Assigns each object to the track of its class with the nearest predicted position."""

    def __init__(self, reach_m: float = 3.0) -> None:  # set by tracker.reach_m=4
        self.reach_m, self.last, self.next_id = reach_m, None, 0

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Return tracks of these objects (N), world frame; refuse a stamp that is not later."""
        if self.last is not None and stamp_ns <= self.last.stamp_ns:
            raise InputError("stamp_ns", stamp_ns, f"later than {self.last.stamp_ns}")
        ids, velocity_mps = self._matched(stamp_ns, objects)
        if objects.velocity is not None:  # measured: by flow, a radar, the detector
            seen = objects.velocity.valid[:, None]
            velocity_mps = np.where(seen, objects.velocity.mean_mps, velocity_mps)
        n = len(objects)
        self.last = Tracks(
            stamp_ns=stamp_ns,
            centre_m=objects.centre_m,
            size_m=objects.size_m,
            yaw_rad=objects.yaw_rad,
            label=objects.label,
            id=ids,
            score=objects.score,
            velocity_mps=velocity_mps,
            velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
            state=np.column_stack([objects.centre_m[:, :2], velocity_mps]),  # any state of yours
            covariance=np.tile(np.eye(4), (n, 1, 1)),
            observed=np.ones(n, dtype=bool),
        )
        return self.last

    def _matched(self, stamp_ns: int, objects: Objects) -> tuple[np.ndarray, np.ndarray]:
        """Return (N,) identities and (N, 2) velocities by difference of positions."""
        n = len(objects)
        ids, velocity_mps = np.arange(self.next_id, self.next_id + n), np.zeros((n, 2))
        self.next_id += n
        if self.last is None:
            return ids, velocity_mps
        elapsed_s = seconds_between(self.last.stamp_ns, stamp_ns)
        predicted_m = self.last.centre_m[:, :2] + elapsed_s * self.last.velocity_mps
        apart_m = np.linalg.norm(objects.centre_m[:, None, :2] - predicted_m, axis=2)
        apart_m[objects.label[:, None] != self.last.label] = 1e6
        new, old = linear_sum_assignment(apart_m)
        near = apart_m[new, old] < self.reach_m
        new, old = new[near], old[near]
        ids[new] = self.last.id[old]
        moved_m = objects.centre_m[new, :2] - self.last.centre_m[old, :2]
        velocity_mps[new] = moved_m / elapsed_s
        return ids, velocity_mps


if __name__ == "__main__":
    print(__doc__)  # it is loaded by name: the command is there

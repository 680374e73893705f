r"""Radar velocities for the Kalman tracker: an object source whose boxes carry them.

PYTHONPATH=examples mottrack compare demo flow=zero objects=detections,own_radar:RadarBoxes \
    --out out/radar
"""

import numpy as np

from mottrack import Objects, Sweep, VelocityMeasurement
from mottrack.core import Frame, ObjectSourceBase


class RadarBoxes(ObjectSourceBase):
    """The data set's detections with the speed of the nearest true box along the beam, and noise.

    A real radar would be read here; measured flow is fused with it.
    """

    needs_sweeps, needs_detections = False, True  # reads boxes, no points

    def __init__(self, sigma_mps: float = 0.2, reach_m: float = 2.0) -> None:
        self.sigma_mps, self.reach_m = sigma_mps, reach_m
        self.reset()

    def reset(self) -> None:
        """Start a new scene."""
        self.noise = np.random.default_rng(0)

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Return the frame's detections (N), world frame, with a speed along each beam in m/s."""
        boxes, truth = frame.detections, frame.truth
        if not len(boxes) or not len(truth):
            return boxes
        beam = boxes.centre_m[:, :2] - frame.world_T_ego.apply(np.zeros((1, 3)))[0, :2]
        beam /= np.linalg.norm(beam, axis=1, keepdims=True)
        apart_m = np.linalg.norm(boxes.centre_m[:, None, :2] - truth.centre_m[:, :2], axis=2)
        nearest = apart_m.argmin(axis=1)
        speed_mps = np.sum(truth.velocity_mps[nearest] * beam, axis=1)
        seen = (apart_m.min(axis=1) < self.reach_m) & np.isfinite(speed_mps)
        speed_mps = np.where(seen, speed_mps + self.noise.normal(0, self.sigma_mps, len(boxes)), 0)
        variance_m2ps2 = np.full(len(boxes), self.sigma_mps**2)
        along = VelocityMeasurement.along(beam, speed_mps, variance_m2ps2)
        measured = VelocityMeasurement(along.mean_mps, along.covariance_m2ps2, seen)
        return boxes.with_velocity(measured)


if __name__ == "__main__":
    print(__doc__)  # it is loaded by name: the command is there

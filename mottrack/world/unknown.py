"""Unknown objects (out of the ontology): an animal, a thrown ball, debris on the road."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.world.catalogue import UNKNOWN, Size
from mottrack.world.roads import RoadNetwork
from mottrack.world.states import States

_GRAVITY_MPS2 = 9.81
_STRAIGHT_RADPS = 1e-6  # A yaw rate of 0 would be a circle of infinite radius


class _Unknown(NamedTuple):
    size_m: Size
    slowest_mps: float
    fastest_mps: float
    share: float
    """Of all unknown objects."""


# a dog up to its gallop, a ball rolled or thrown, something blown along the road; by eye
_KINDS = {
    "animal": _Unknown(Size(0.9, 0.3, 0.7), 0.5, 5.0, 0.4),
    "ball": _Unknown(Size(0.3, 0.3, 0.3), 3.0, 10.0, 0.3),
    "debris": _Unknown(Size(0.8, 0.6, 0.45), 0.0, 4.0, 0.3),
}


@dataclass(frozen=True)
class UnknownObjects:
    """N objects on circles at constant speed; balls bounce."""

    label: Texts
    size_m: F64
    """(N, 3)"""
    start: F64
    """(N, 3) x, y, heading at time 0."""
    speed_mps: F64
    yaw_rate_radps: F64
    bounce_mps: F64
    """(N,) upward speed at each bounce."""

    def states(self, time_s: float) -> States:
        """Return their states at a time."""
        straight = np.abs(self.yaw_rate_radps) < _STRAIGHT_RADPS
        rate = np.where(straight, _STRAIGHT_RADPS, self.yaw_rate_radps)
        yaw = self.start[:, 2] + rate * time_s
        radius = self.speed_mps / rate
        x = self.start[:, 0] + radius * (np.sin(yaw) - np.sin(self.start[:, 2]))
        y = self.start[:, 1] - radius * (np.cos(yaw) - np.cos(self.start[:, 2]))
        flies = self.bounce_mps > 0
        period = np.where(flies, 2.0 * self.bounce_mps / _GRAVITY_MPS2, 1.0)
        tau = np.mod(time_s, period) * flies
        height = self.bounce_mps * tau - 0.5 * _GRAVITY_MPS2 * tau**2
        climb = (self.bounce_mps - _GRAVITY_MPS2 * tau) * flies
        velocity = self.speed_mps[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
        pull = (rate * self.speed_mps)[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw)])
        return States(
            xy_m=np.column_stack([x, y]),
            lift_m=np.maximum(height, 0.0),
            yaw_rad=yaw,
            velocity_mps=np.column_stack([velocity, climb]),
            acceleration_mps2=np.column_stack([pull, np.where(flies, -_GRAVITY_MPS2, 0.0)]),
            yaw_rate_radps=rate,
            travelled_m=self.speed_mps * time_s,
        )


def draw_unknown_objects(
    rng: np.random.Generator, network: RoadNetwork, mean_count: float, near_s_m: float
) -> UnknownObjects:
    """Draw objects about the main road near arc length ``near_s_m``, mostly ahead of it."""
    count = int(rng.poisson(mean_count))
    shares = [_KINDS[name].share for name in UNKNOWN]
    label = rng.choice(np.array(UNKNOWN), size=count, p=shares)
    road = network.roads[0]
    s = near_s_m + rng.uniform(-20.0, 60.0, count)
    edge = road.profile.half_m - 0.4
    start = road.centre.at(s, rng.uniform(-edge, edge, count))
    start[:, 2] += rng.uniform(-np.pi, np.pi, count)
    scale = rng.uniform(0.7, 1.3, (count, 1))
    kinds = [_KINDS[name] for name in label]
    size = np.array([kind.size_m for kind in kinds]).reshape(count, 3) * scale
    low = np.array([kind.slowest_mps for kind in kinds])
    high = np.array([kind.fastest_mps for kind in kinds])
    speed = low + (high - low) * rng.random(count) ** 1.5  # the slow half of the range more often
    yaw_rate = rng.normal(0.0, 0.3, count) * (label != "ball")
    bounce = rng.uniform(1.0, 4.0, count) * (label == "ball")
    return UnknownObjects(label, size, start, speed, yaw_rate, bounce)

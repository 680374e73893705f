"""Movers that no detector knows: an animal, a thrown ball, debris on the road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.world.roads import RoadNetwork
from mottrack.world.states import States

_GRAVITY_MPS2 = 9.81
_SIZES = {"animal": (0.9, 0.3, 0.7), "ball": (0.3, 0.3, 0.3), "debris": (0.8, 0.6, 0.45)}
_SPEEDS = {"animal": (0.5, 5.0), "ball": (3.0, 10.0), "debris": (0.0, 4.0)}


@dataclass(frozen=True)
class Strays:
    """N movers on circles at constant speed; balls bounce on the way."""

    label: Texts
    size_m: F64
    start: F64
    """(N, 3) x, y, heading at time 0."""
    speed_mps: F64
    yaw_rate_radps: F64
    bounce_mps: F64
    """(N,) upward speed at each bounce."""

    def states(self, time_s: float) -> States:
        """Where they are at a time."""
        rate = np.where(np.abs(self.yaw_rate_radps) < 1e-6, 1e-6, self.yaw_rate_radps)
        yaw = self.start[:, 2] + rate * time_s
        radius = self.speed_mps / rate
        x = self.start[:, 0] + radius * (np.sin(yaw) - np.sin(self.start[:, 2]))
        y = self.start[:, 1] - radius * (np.cos(yaw) - np.cos(self.start[:, 2]))
        lift, climb, fall = self._flight(time_s)
        velocity = self.speed_mps[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
        pull = (rate * self.speed_mps)[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw)])
        return States(
            np.column_stack([x, y]),
            lift,
            yaw,
            np.column_stack([velocity, climb]),
            np.column_stack([pull, fall]),
            rate,
            self.speed_mps * time_s,
        )

    def _flight(self, time_s: float) -> tuple[F64, F64, F64]:
        """Height, climb rate and vertical acceleration of what bounces."""
        flies = self.bounce_mps > 0
        period = np.where(flies, 2.0 * self.bounce_mps / _GRAVITY_MPS2, 1.0)
        tau = np.mod(time_s, period) * flies
        height = self.bounce_mps * tau - 0.5 * _GRAVITY_MPS2 * tau**2
        climb = (self.bounce_mps - _GRAVITY_MPS2 * tau) * flies
        return np.maximum(height, 0.0), climb, np.where(flies, -_GRAVITY_MPS2, 0.0)


def draw_strays(
    rng: np.random.Generator, network: RoadNetwork, mean_count: float, near_s_m: float
) -> Strays:
    """Strays about the main road near arc length ``near_s_m``."""
    count = int(rng.poisson(mean_count))
    label = rng.choice(np.array(sorted(_SIZES)), size=count, p=[0.4, 0.3, 0.3])
    road = network.roads[0]
    s = near_s_m + rng.uniform(-20.0, 60.0, count)
    edge = road.profile.half_m - 0.4
    start = road.centre.at(s, rng.uniform(-edge, edge, count))
    start[:, 2] += rng.uniform(-np.pi, np.pi, count)
    scale = rng.uniform(0.7, 1.3, (count, 1))
    size = np.array([_SIZES[name] for name in label]).reshape(count, 3) * scale
    low = np.array([_SPEEDS[name][0] for name in label])
    high = np.array([_SPEEDS[name][1] for name in label])
    speed = low + (high - low) * rng.random(count) ** 1.5
    turn = rng.normal(0.0, 0.3, count) * (label != "ball")
    bounce = rng.uniform(1.0, 4.0, count) * (label == "ball")
    return Strays(label, size, start, speed, turn, bounce)

"""A street whose motion is known: walls, posts, ground, and one car that drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.objects import Objects, Truth
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep

CAR_M = np.array([4.5, 1.9, 1.5])
SENSOR_M = np.array([0.0, 0.0, 1.8])
STEP_NS = 100_000_000


@dataclass(frozen=True)
class Street:
    """The car's pose over time, and the ego's; the world never changes otherwise."""

    car_start_m: tuple[float, float] = (12.0, 3.0)
    car_yaw_rad: float = 0.0
    speed_mps: float = 8.0
    turn_radps: float = 0.0
    ego_mps: float = 0.0
    seed: int = 0

    def car(self, step: int) -> Pose:
        """`world_T_car` by small steps of the unicycle."""
        x, y, yaw = *self.car_start_m, self.car_yaw_rad
        for _ in range(step * 10):
            x += self.speed_mps * 0.01 * np.cos(yaw)
            y += self.speed_mps * 0.01 * np.sin(yaw)
            yaw += self.turn_radps * 0.01
        return Pose.from_yaw(yaw, (x, y, CAR_M[2] / 2 + 0.2))

    def ego(self, step: int) -> Pose:
        """`world_T_ego`; the ego drives along x."""
        return Pose.from_yaw(0.0, (self.ego_mps * 0.1 * step, 0.0, 0.0))

    def sweep(self, step: int) -> Sweep:
        """The visible sides of the car, walls, posts and ground, sampled anew at each step."""
        rng = np.random.default_rng([self.seed, step])
        world = np.concatenate([_background(rng), self._car_points(step, rng)])
        xyz = self.ego(step).inverse().apply(world) + rng.normal(0, 0.01, world.shape)
        return Sweep(
            xyz.astype(np.float32),
            np.full(len(xyz), 0.5),
            (step + 1) * STEP_NS,
            self.ego(step),
            SENSOR_M,
        )

    def frame(self, step: int) -> Frame:
        """Detections and truth of the car alone."""
        car = self.car(step)
        box = {
            "stamp_ns": (step + 1) * STEP_NS,
            "frame": "world",
            "centre_m": car.translation_m[None],
            "size_m": CAR_M[None],
            "yaw_rad": np.array([car.yaw_rad]),
            "label": np.array(["car"]),
        }
        velocity = self.speed_mps * np.array([[np.cos(car.yaw_rad), np.sin(car.yaw_rad)]])
        truth = Truth(
            **box,
            id=np.array([7]),
            velocity_mps=velocity,
            num_points=np.array([100]),
            interpolated=np.array([False]),
        )
        return Frame(box["stamp_ns"], self.ego(step), Objects(**box, score=np.array([0.9])), truth)

    def car_cells(self, step: int, grid: BevGrid) -> np.ndarray:
        """(H, W) cells whose centre lies in the car, a little grown."""
        car_T_ego = self.car(step).inverse() @ self.ego(step)
        centres = grid.centres_m().reshape(-1, 2)
        local = car_T_ego.apply(np.column_stack([centres, np.full(len(centres), 0.95)]))
        inside = (np.abs(local[:, :2]) < CAR_M[:2] / 2 + 0.3).all(axis=1)
        return inside.reshape(grid.shape)

    def _car_points(self, step: int, rng: np.random.Generator) -> np.ndarray:
        half = CAR_M / 2
        side = rng.uniform(-1, 1, (2000, 3)) * half
        face = rng.integers(0, 4, 2000)
        side[face == 0, 0], side[face == 1, 0] = -half[0], half[0]
        side[face == 2, 1], side[face == 3, 1] = -half[1], half[1]
        car, ego = self.car(step), self.ego(step)
        normal = np.zeros((2000, 3))
        normal[np.arange(2000), face // 2] = np.where(face % 2 == 0, -1.0, 1.0)
        to_sensor = ego.apply(SENSOR_M[None])[0] - car.apply(side)
        visible = ((normal @ car.rotation.T) * to_sensor).sum(axis=1) > 0
        return car.apply(side[visible])


def _background(rng: np.random.Generator) -> np.ndarray:
    """A wall along x, one across, posts, and the road; heights over the road at z = 0."""
    wall = np.column_stack(
        [rng.uniform(-30, 45, 2500), np.full(2500, 14.0), rng.uniform(0, 3, 2500)]
    )
    across = np.column_stack(
        [np.full(800, -25.0), rng.uniform(-20, 14, 800), rng.uniform(0, 3, 800)]
    )
    posts = np.concatenate(
        [
            np.column_stack(
                [rng.normal(x, 0.08, 60), rng.normal(-10, 0.08, 60), rng.uniform(0, 2.5, 60)]
            )
            for x in range(-20, 40, 8)
        ]
    )
    angle, radius = rng.uniform(-np.pi, np.pi, 9000), 60 * np.sqrt(rng.uniform(0.003, 1, 9000))
    road = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(9000)])
    return np.concatenate([wall, across, posts, road[road[:, 1] < 14]])


@pytest.fixture(scope="session")
def street_of():
    """Makes a street: `street_of(speed_mps=8.0, ...)`."""
    return Street

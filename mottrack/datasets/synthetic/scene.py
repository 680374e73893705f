"""One scene of the embedded world."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.objects import Objects, Truth
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import Sweep
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.world.catalogue import TRACKED
from mottrack.world.detector import Clock, Ghosts, Seen, detect, draw_ghosts
from mottrack.world.ego import PoseError, pose_of
from mottrack.world.sensor import random_sensor, sensor_model
from mottrack.world.sweep_maker import PointTruth, Rig, ScanResult, scan
from mottrack.world.terrain import heights_at
from mottrack.world.traffic import Density
from mottrack.world.world import World, WorldPlan, build_world

_WARM_UP_S = 4.0
_WORLD, _RIG, _SWEEP, _GHOSTS, _DETECTOR = range(5)
_KEPT_SHOTS = 4


class SyntheticScene:
    """A drive through a world of its own; sweeps and frames can be asked for in any order.

    Building the world takes about a second and happens at the first question.
    """

    def __init__(self, config: SyntheticConfig, number: int) -> None:
        self._config, self._number = config, number
        self._shot: Callable[[int], ScanResult] = lru_cache(_KEPT_SHOTS)(self._shoot)

    @property
    def name(self) -> str:
        """``synthetic-s<seed>-<number>``."""
        return scene_name(self._config.seed, self._number)

    @property
    def classes(self) -> tuple[str, ...]:
        """The seven tracked classes; truth also names what no detector reports."""
        return TRACKED

    @property
    def has_sweeps(self) -> bool:
        """Always."""
        return True

    def __len__(self) -> int:
        return max(round(self._config.duration_s * self._config.sweep_hz), 1)

    def sweep(self, index: int) -> Sweep:
        """The sweep at ``index``, points in the ego frame, pose by odometry.

        Raises:
            InputError: there is no such sweep.
        """
        return self._shot(self._checked(index)).sweep

    def sweep_truth(self, index: int) -> PointTruth:
        """What each point of ``sweep(index)`` belongs to.

        Raises:
            InputError: there is no such sweep.
        """
        return self._shot(self._checked(index)).truth

    def frame(self, index: int) -> Frame:
        """Pose, detections and truth at the stamp of ``sweep(index)``, world frame.

        Raises:
            InputError: there is no such sweep.
        """
        shot = self._shot(self._checked(index))
        every = self._config.sweep_hz // self._config.key_hz
        return Frame(
            stamp_ns=shot.sweep.stamp_ns,
            world_T_ego=shot.sweep.world_T_ego,
            detections=self._detections(shot),
            truth=self._truth(shot),
            is_key=index % every == 0,
            token=f"{self.name}-{index:05d}",
        )

    @cached_property
    def world(self) -> World:
        """What the scene consists of."""
        config = self._config
        density = Density(**config.density.model_dump())
        plan = WorldPlan(config.place, density, config.duration_s, _WARM_UP_S)
        return build_world(np.random.default_rng(self._source(_WORLD)), plan)

    @cached_property
    def rig(self) -> Rig:
        """The sensor on the vehicle."""
        rng = np.random.default_rng(self._source(_RIG))
        name = self._config.sensor
        sensor = random_sensor(rng) if name == "random" else sensor_model(name)
        error = self._config.pose_error
        return Rig(
            sensor=sensor,
            period_s=1.0 / self._config.sweep_hz,
            rolling=self._config.rolling,
            pose_error=PoseError(
                error.jitter_m,
                float(np.deg2rad(error.jitter_deg)),
                error.drift_m,
                float(np.deg2rad(error.drift_deg)),
            ),
        )

    @cached_property
    def _ghosts(self) -> Ghosts:
        rng = np.random.default_rng(self._source(_GHOSTS))
        static = self.world.static
        low = static.half_m[:, 2] < 3.0
        places = np.column_stack([static.centre_m[low, :2], static.yaw_rad[low]])
        floor = heights_at(self.world.terrain, np.ascontiguousarray(places[:, :2]))
        table = np.insert(places, 2, floor, axis=1)
        count = round(0.25 * len(table) * min(self._config.detector.false_positives, 3.0))
        return draw_ghosts(rng, count, table)

    def _checked(self, index: int) -> int:
        if not 0 <= index < len(self):
            raise InputError("index", index, f"a sweep of {self.name} in 0 .. {len(self) - 1}")
        return int(index)

    def _source(self, *purpose: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._config.seed, spawn_key=(self._number, *purpose))

    def _shoot(self, index: int) -> ScanResult:
        time_s = index / self._config.sweep_hz
        return scan(self.world, self.rig, time_s, self._source(_SWEEP, index))

    def _truth(self, shot: ScanResult) -> Truth:
        world, states = self.world, shot.states
        away = np.hypot(*(states.xy_m - shot.posture[:2]).T)
        rows = np.flatnonzero(away < self._config.truth_range_m)
        rows = rows[rows != 0]
        size, floor = world.size_m[rows], world.floor_m(states)[rows]
        return Truth(
            stamp_ns=shot.sweep.stamp_ns,
            frame="world",
            centre_m=np.column_stack([states.xy_m[rows], floor + 0.5 * size[:, 2]]),
            size_m=size,
            yaw_rad=wrap_angle(states.yaw_rad[rows]),
            label=world.label[rows],
            id=rows,
            velocity_mps=states.velocity_mps[rows, :2],
            num_points=shot.count[rows],
            interpolated=np.zeros(len(rows), dtype=np.bool_),
        )

    def _detections(self, shot: ScanResult) -> Objects:
        """Boxes found in the true ego frame, put into the world by the odometry."""
        ego_T_world = pose_of(shot.posture).inverse()
        truth = self._truth(shot)
        known = truth.select(np.isin(truth.label, TRACKED)).transformed(ego_T_world, "ego")
        seen = Seen(
            known.centre_m, known.size_m, known.yaw_rad, known.label, known.id, known.num_points
        )
        ghosts, rates = self._near_ghosts(shot)
        seed = int(self._source(_DETECTOR).generate_state(1)[0])
        clock = Clock(seed, shot.sweep.stamp_ns)
        found = detect(seen, ghosts, rates, self._config.detector, clock)
        return found.transformed(shot.sweep.world_T_ego, "world")

    def _near_ghosts(self, shot: ScanResult) -> tuple[Seen, F64]:
        ghosts, reach = self._ghosts, self._config.detector.max_range_m
        away = np.hypot(*(ghosts.xy_m - shot.posture[:2]).T)
        rows = np.flatnonzero(away < 0.85 * reach)
        tall = 0.5 * ghosts.size_m[rows, 2]
        centre = np.column_stack([ghosts.xy_m[rows], ghosts.floor_m[rows] + tall])
        pose = pose_of(shot.posture).inverse()
        yaw = ghosts.yaw_rad[rows] + pose.yaw_rad
        seen = Seen(
            pose.apply(centre), ghosts.size_m[rows], yaw, ghosts.label[rows], rows,
            np.full(len(rows), 6),
        )  # fmt: skip
        rates = ghosts.rate[rows] * self._config.detector.false_positives
        return seen, np.clip(0.6 * rates, 0.0, 0.95)


def scene_name(seed: int, number: int) -> str:
    """Name of scene ``number`` of a seed."""
    return f"synthetic-s{seed:04d}-{number:04d}"

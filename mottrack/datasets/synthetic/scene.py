"""One scene of the embedded world."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np

from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.objects import Objects, Truth
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import Sweep
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.world.catalogue import TRACKED
from mottrack.world.detector import (
    FalsePositiveSites,
    FrameDraws,
    Visible,
    detect,
    draw_false_positive_sites,
)
from mottrack.world.ego import PoseError, pose_of
from mottrack.world.sensor import random_sensor, sensor_model
from mottrack.world.sweep_maker import PointTruth, Rig, ScanResult, scan
from mottrack.world.terrain import heights_at
from mottrack.world.world import World, WorldPlan, build_world

_WARM_UP_S = 4.0  # Enough for traffic that starts at random speeds to settle into following
_WORLD, _RIG, _SWEEP, _FALSE_SITES, _DETECTOR = range(5)
_KEPT_SCANS = 4
"""A reader asks for the sweep, its truth and its frame, and for those of the sweep before."""
_LOW_M = 3.0  # Solids lower than twice this may be mistaken for objects: no facades, decks or trees
_FALSE_SITE_SHARE, _MOST_FALSE_FACTOR = 0.25, 3.0
_FALSE_RANGE_SHARE, _FALSE_RATE, _MOST_FALSE_RATE = 0.85, 0.6, 0.95
# chosen by eye, so that a frame of a town has some ten false positives, most with low scores
_FALSE_POINTS = 6  # Returns of a false positive, which set its noise


class SyntheticScene:
    """A drive through a world of its own; sweeps and frames can be asked for in any order.

    Building the world takes about a second and happens at the first question.
    """

    def __init__(self, config: SyntheticConfig, number: int) -> None:
        self._config, self._number = config, number
        self._scan: Callable[[int], ScanResult] = lru_cache(_KEPT_SCANS)(self._simulate)

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

    def scan(self, index: int) -> ScanResult:
        """Return the simulated scan at ``index``: the sweep, its truth, and the true states.

        Raises:
            InputError: there is no such sweep.
        """
        if not 0 <= index < len(self):
            raise InputError("index", index, f"a sweep of {self.name} in 0 .. {len(self) - 1}")
        return self._scan(int(index))

    def sweep(self, index: int) -> Sweep:
        """Return the sweep at ``index``, points in the ego frame, pose by odometry.

        Raises:
            InputError: there is no such sweep.
        """
        return self.scan(index).sweep

    def sweep_truth(self, index: int) -> PointTruth:
        """Return what each point of ``sweep(index)`` belongs to.

        Raises:
            InputError: there is no such sweep.
        """
        return self.scan(index).truth

    def frame(self, index: int) -> Frame:
        """Return pose, detections and truth at the stamp of ``sweep(index)``, world frame.

        Raises:
            InputError: there is no such sweep.
        """
        scan, every = self.scan(index), self._config.sweep_hz // self._config.key_hz
        truth = self._truth(scan)
        return Frame(
            stamp_ns=scan.sweep.stamp_ns,
            world_T_ego=scan.sweep.world_T_ego,
            detections=self._detections(scan, truth),
            truth=truth,
            is_key=index % every == 0,
            token=f"{self.name}-{index:05d}",
        )

    @cached_property
    def world(self) -> World:
        """Everything in the scene."""
        config = self._config
        plan = WorldPlan(config.place, config.density, config.duration_s, _WARM_UP_S)
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
    def _false_sites(self) -> FalsePositiveSites:
        rng = np.random.default_rng(self._source(_FALSE_SITES))
        static = self.world.static
        low = static.half_m[:, 2] < _LOW_M
        places = np.column_stack([static.centre_m[low, :2], static.yaw_rad[low]])
        floor = heights_at(self.world.terrain, np.ascontiguousarray(places[:, :2]))
        table = np.insert(places, 2, floor, axis=1)
        factor = min(self._config.detector.false_positives, _MOST_FALSE_FACTOR)
        return draw_false_positive_sites(rng, round(_FALSE_SITE_SHARE * len(table) * factor), table)

    def _source(self, *purpose: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._config.seed, spawn_key=(self._number, *purpose))

    def _simulate(self, index: int) -> ScanResult:
        time_s = index / self._config.sweep_hz
        return scan(self.world, self.rig, time_s, self._source(_SWEEP, index))

    def _truth(self, scan: ScanResult) -> Truth:
        world, states = self.world, scan.states
        away = np.hypot(*(states.xy_m - scan.posture[:2]).T)
        rows = np.flatnonzero(away < self._config.truth_range_m)
        rows = rows[rows != 0]
        size, floor = world.size_m[rows], world.floor_m(states)[rows]
        return Truth(
            stamp_ns=scan.sweep.stamp_ns,
            frame="world",
            centre_m=np.column_stack([states.xy_m[rows], floor + 0.5 * size[:, 2]]),
            size_m=size,
            yaw_rad=wrap_angle(states.yaw_rad[rows]),
            label=world.label[rows],
            id=rows,
            velocity_mps=states.velocity_mps[rows, :2],
            num_points=scan.count[rows],
            interpolated=np.zeros(len(rows), dtype=np.bool_),
        )

    def _detections(self, scan: ScanResult, truth: Truth) -> Objects:
        """Return boxes detected in the true ego frame, put into the world by the odometry."""
        ego_T_world = pose_of(scan.posture).inverse()
        known = truth.select(np.isin(truth.label, TRACKED)).transformed(ego_T_world, "ego")
        visible = Visible(
            known.centre_m, known.size_m, known.yaw_rad, known.label, known.id, known.num_points
        )
        config, sites = self._config.detector, self._false_sites
        away = np.hypot(*(sites.xy_m - scan.posture[:2]).T)
        rows = np.flatnonzero(away < _FALSE_RANGE_SHARE * config.max_range_m)
        tall = 0.5 * sites.size_m[rows, 2]
        imagined = Visible(
            centre_m=ego_T_world.apply(
                np.column_stack([sites.xy_m[rows], sites.floor_m[rows] + tall])
            ),
            size_m=sites.size_m[rows],
            yaw_rad=sites.yaw_rad[rows] + ego_T_world.yaw_rad,
            label=sites.label[rows],
            id=rows,
            num_points=np.full(len(rows), _FALSE_POINTS),
        )
        rates = sites.rate[rows] * config.false_positives
        draws = FrameDraws(int(self._source(_DETECTOR).generate_state(1)[0]), scan.sweep.stamp_ns)
        rates = np.clip(_FALSE_RATE * rates, 0.0, _MOST_FALSE_RATE)
        found = detect(visible, imagined, rates, config, draws)
        return found.transformed(scan.sweep.world_T_ego, "world")


def scene_name(seed: int, number: int) -> str:
    """Return the name of scene ``number`` of a seed."""
    return f"synthetic-s{seed:04d}-{number:04d}"

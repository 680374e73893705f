"""Sweeps for training, two or more of a drive: each from a world and a sensor of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.sweep import Sweep
from mottrack.world.config import DensityConfig
from mottrack.world.ego import PoseError
from mottrack.world.sensor import SensorModel, random_sensor
from mottrack.world.states import States
from mottrack.world.sweep_maker import PointTruth, Rig, scan
from mottrack.world.world import World, WorldPlan, build_world

_WORLD, _RIG, _FIRST, _SECOND, _DRIVE, _OLDER = range(6)
_SPAWN_KEY = 1_000_003
"""Keeps the draws of training pairs apart from those of scenes, whose keys are below it."""
_WARM_UP_S = 0.3  # Three steps of the traffic: a pair needs no settled queues
_SIGHT_M = 85.0
"""Beyond the corners of the grids that networks learn on; a scene's would take longer to build."""


class TrainingConfig(StrictModel):
    """How much training pairs vary."""

    intervals_s: tuple[float, ...] = Field(
        (0.1,), min_length=1, description="times between the two sweeps to choose from"
    )
    older_ages_s: tuple[float, ...] = Field(
        (), description="ages of further sweeps of the past, from the youngest on"
    )
    older_spread_s: float = Field(
        0.1, ge=0.0, description="these ages differ by up to this from example to example"
    )
    rolling_share: float = Field(0.8, ge=0.0, le=1.0, description="pairs with a rolling scan")
    worst_jitter_m: float = Field(0.025, ge=0.0, le=1.0, description="largest pose error")
    worst_jitter_deg: float = Field(0.1, ge=0.0, le=5.0, description="largest heading error")
    worst_tilt_deg: float = Field(1.5, ge=0.0, le=10.0, description="largest tilt of a sensor")
    turning_share: float = Field(
        0.0, ge=0.0, le=1.0, description="pairs whose ego vehicle turns at an intersection"
    )
    motorway_share: float = Field(
        0.0, ge=0.0, le=1.0, description="pairs whose ego vehicle drives fast on a motorway"
    )
    lost_rings_share: float = Field(
        0.0, ge=0.0, le=1.0, description="pairs of a sensor that has lost up to half of its rings"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        youngest = max(self.intervals_s) + self.older_spread_s
        if self.older_ages_s and min(self.older_ages_s) <= youngest:
            raise ValueError(
                f"older_ages_s above {youngest:g}, the longest of intervals_s and older_spread_s"
            )
        if list(self.older_ages_s) != sorted(self.older_ages_s):
            raise ValueError("older_ages_s from the youngest on")
        if self.turning_share + self.motorway_share > 1:
            raise ValueError("turning_share and motorway_share together at most 1")
        return self


@dataclass(frozen=True)
class PastScan:
    """An earlier sweep, in its own ego frame, with what its points belong to."""

    sweep: Sweep
    truth: PointTruth
    """Velocities are at the sweep's stamp in its ego axes; identities agree between sweeps."""
    states: States
    """All agents at the stamp, world frame."""


@dataclass(frozen=True)
class TrainingPair:
    """A current sweep and earlier ones of the same drive, each in its own ego frame."""

    current: Sweep
    current_truth: PointTruth
    current_states: States
    past: tuple[PastScan, ...]
    """From the youngest, the other sweep of the pair, to the oldest."""

    @property
    def previous(self) -> Sweep:
        """The earlier sweep of the pair."""
        return self.past[0].sweep


def training_pair(seed: int, index: int, config: TrainingConfig | None = None) -> TrainingPair:
    """Build pair ``index`` of a seed: the same on every call and in any process.

    Args:
        seed: of the training set.
        index: of the pair.
        config: how much pairs vary.
    """
    config = config or TrainingConfig()
    rng = np.random.default_rng(_source(seed, index, _WORLD))
    interval = float(rng.choice(config.intervals_s))
    drive = _drive(np.random.default_rng(_source(seed, index, _DRIVE)), config)
    ages = [interval, *drive.ages_s]
    world = _world(rng, ages[-1], drive)
    rig = _rig(np.random.default_rng(_source(seed, index, _RIG)), config, interval)
    rig = replace(rig, sensor=_with_rings(rig.sensor, drive.kept_rings))
    purposes = [_FIRST, *(_OLDER + k for k in range(len(drive.ages_s)))]
    past = [
        scan(world, rig, ages[-1] - age, _source(seed, index, purpose))
        for age, purpose in zip(ages, purposes, strict=True)
    ]
    now = scan(world, rig, ages[-1], _source(seed, index, _SECOND))
    return TrainingPair(
        now.sweep,
        now.truth,
        now.states,
        tuple(PastScan(then.sweep, then.truth, then.states) for then in past),
    )


class _Drive(NamedTuple):
    """What is drawn beside the world and the sensor."""

    ages_s: list[float]
    """Of the older sweeps."""
    place: str
    ego: str
    kept_rings: float
    """Share of the sensor's rings."""


def _drive(rng: np.random.Generator, config: TrainingConfig) -> _Drive:
    spread_s = rng.uniform(-1.0, 1.0) * config.older_spread_s
    ages_s = [round(age_s + spread_s, 2) for age_s in config.older_ages_s]
    kept = float(rng.uniform(0.5, 1.0)) if rng.random() < config.lost_rings_share else 1.0
    kind = rng.random()
    if kind < config.turning_share:
        place = str(rng.choice(["urban", "residential"], p=[0.6, 0.4]))  # as in all scenes
        return _Drive(ages_s, place, "turning", kept)
    if kind < config.turning_share + config.motorway_share:
        return _Drive(ages_s, "motorway", "fast", kept)
    return _Drive(ages_s, "random", "any", kept)


def _with_rings(sensor: SensorModel, share: float) -> SensorModel:
    """Return the sensor with a share of its rings, spread evenly."""
    rings = len(sensor.elevation_rad)
    kept = np.unique(np.linspace(0, rings - 1, max(round(share * rings), 16)).astype(np.int64))
    if len(kept) >= rings:
        return sensor
    elevation, offset = sensor.elevation_rad[kept], sensor.offset_rad[kept]
    return replace(sensor, elevation_rad=elevation, offset_rad=offset)


def _source(seed: int, index: int, purpose: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(_SPAWN_KEY, index, purpose))


# the ranges below are chosen by eye, around what scenes have by default
def _world(rng: np.random.Generator, duration_s: float, drive: _Drive) -> World:
    density = DensityConfig(
        vehicles=float(rng.uniform(0.5, 1.6)),
        pedestrians=float(rng.uniform(0.4, 2.0)),
        parked=float(rng.uniform(0.6, 1.1)),
        unknown=2.0,
    )
    plan = WorldPlan(
        drive.place, density, duration_s, _WARM_UP_S, _SIGHT_M, mid_turn=True, ego=drive.ego
    )
    return build_world(rng, plan)


def _rig(rng: np.random.Generator, config: TrainingConfig, interval_s: float) -> Rig:
    jitter = float(rng.beta(1.0, 2.0))
    tilt = np.deg2rad(config.worst_tilt_deg) * rng.uniform(-1.0, 1.0, 2)
    period = min(interval_s, float(rng.choice([0.05, 0.1], p=[0.3, 0.7])))  # 20 or 10 Hz
    return Rig(
        sensor=replace(random_sensor(rng), max_range_m=_SIGHT_M),
        period_s=period,
        rolling=bool(rng.random() < config.rolling_share),
        tilt_rad=(float(tilt[0]), float(tilt[1])),
        edge_share=float(rng.uniform(0.0, 0.3)),
        pose_error=PoseError(
            jitter_m=config.worst_jitter_m * jitter,
            jitter_rad=float(np.deg2rad(config.worst_jitter_deg)) * jitter,
            drift_m=0.0,
            drift_rad=0.0,
            speed_share=float(rng.uniform(0.0, 0.006)),
        ),
    )

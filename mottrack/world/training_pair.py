"""Pairs of consecutive sweeps for training: each from a world, a sensor and a drive of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.sweep import Sweep
from mottrack.world.config import DensityConfig
from mottrack.world.ego import PoseError
from mottrack.world.sensor import random_sensor
from mottrack.world.sweep_maker import PointTruth, Rig, scan
from mottrack.world.world import World, WorldPlan, build_world

_WORLD, _RIG, _FIRST, _SECOND = range(4)
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
    rolling_share: float = Field(0.8, ge=0.0, le=1.0, description="pairs with a rolling scan")
    worst_jitter_m: float = Field(0.025, ge=0.0, le=1.0, description="largest pose error")
    worst_jitter_deg: float = Field(0.1, ge=0.0, le=5.0, description="largest heading error")
    worst_tilt_deg: float = Field(1.5, ge=0.0, le=10.0, description="largest tilt of a sensor")


@dataclass(frozen=True)
class TrainingPair:
    """Two consecutive sweeps, each in its own ego frame, with what their points belong to.

    The velocities of each truth are at that sweep's stamp in that sweep's ego axes; identities
    agree between the two.
    """

    previous: Sweep
    current: Sweep
    current_truth: PointTruth
    previous_truth: PointTruth


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
    world = _world(rng, interval)
    rig = _rig(np.random.default_rng(_source(seed, index, _RIG)), config, interval)
    first = scan(world, rig, 0.0, _source(seed, index, _FIRST))
    second = scan(world, rig, interval, _source(seed, index, _SECOND))
    return TrainingPair(first.sweep, second.sweep, second.truth, first.truth)


def _source(seed: int, index: int, purpose: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(_SPAWN_KEY, index, purpose))


# the ranges below are chosen by eye, around what scenes have by default
def _world(rng: np.random.Generator, interval_s: float) -> World:
    density = DensityConfig(
        vehicles=float(rng.uniform(0.5, 1.6)),
        pedestrians=float(rng.uniform(0.4, 2.0)),
        parked=float(rng.uniform(0.6, 1.1)),
        unknown=2.0,
    )
    plan = WorldPlan("random", density, interval_s, _WARM_UP_S, _SIGHT_M, mid_turn=True)
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

"""A model of a detector: what it finds, how well, and what it imagines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.world.catalogue import KINDS, TRACKED
from mottrack.world.config import DetectorConfig
from mottrack.world.hashing import mix, unit

_BEST_RECALL = {
    "car": 0.96, "truck": 0.9, "bus": 0.93, "trailer": 0.85,
    "motorcycle": 0.88, "bicycle": 0.82, "pedestrian": 0.9,
}  # fmt: skip
_POINTS_FOR_HALF = {
    "car": 4.0, "truck": 8.0, "bus": 8.0, "trailer": 10.0,
    "motorcycle": 4.0, "bicycle": 4.5, "pedestrian": 3.5,
}  # fmt: skip
_GHOST_SHARES = (0.12, 0.03, 0.32, 0.08, 0.33, 0.04, 0.08)
_STICKY_SHARE = 0.6
_STICKY_S = 0.8
_GHOST_QUALITY = (1.6, 4.0)


@dataclass(frozen=True)
class Ghosts:
    """Places where the detector tends to see something that is not there (G of them)."""

    xy_m: F64
    floor_m: F64
    yaw_rad: F64
    size_m: F64
    label: Texts
    rate: F64
    """(G,) probability to be reported in a frame, when near."""


@dataclass(frozen=True)
class Seen:
    """What stands before the detector at one stamp, ego frame; N objects of the known classes."""

    centre_m: F64
    size_m: F64
    yaw_rad: F64
    label: Texts
    id: I64
    num_points: I64


def recall(seen: Seen, config: DetectorConfig) -> F64:
    """(N,) probability that each object is found: falls with range and with few returns."""
    best = np.array([_BEST_RECALL[name] for name in seen.label])
    half = np.array([_POINTS_FOR_HALF[name] for name in seen.label])
    points = seen.num_points / np.maximum(half, 1.0)
    away = np.hypot(seen.centre_m[:, 0], seen.centre_m[:, 1])
    fade = np.clip(1.15 - (away / config.max_range_m) ** 2 * 0.75, 0.0, 1.0)
    found = best * (1.0 - 0.5 ** (points**1.3)) * fade * (away < config.max_range_m)
    return np.asarray(np.clip(found * config.recall, 0.0, 0.99))


def draw_ghosts(rng: np.random.Generator, count: int, places: F64) -> Ghosts:
    """Ghosts at ``count`` of the (K, 4) places x, y, floor, yaw."""
    count = min(count, len(places))
    chosen = places[rng.choice(len(places), count, replace=False)] if count else places[:0]
    label = rng.choice(np.array(TRACKED), size=count, p=_GHOST_SHARES)
    mean = np.array(
        [[KINDS[n].length_m[0], KINDS[n].width_m[0], KINDS[n].height_m[0]] for n in label]
    )
    size = mean.reshape(count, 3) * rng.uniform(0.75, 1.1, (count, 3))
    yaw = chosen[:, 3] + rng.normal(0.0, 0.4, count)
    return Ghosts(chosen[:, :2], chosen[:, 2], yaw, size, label, rng.beta(0.8, 2.5, count))


@dataclass(frozen=True)
class Clock:
    """Ties the draws of one frame: the same thing tends to be missed again and again."""

    seed: int
    stamp_ns: int

    def uniforms(self, identity: I64, purpose: int) -> F64:
        """(N,) uniform numbers, the same over _STICKY_S for most of the time."""
        block_ns = round(1e9 * _STICKY_S)
        start = np.uint64(self.seed * 64 + purpose)
        return np.asarray(_sticky_uniforms(start, identity, self.stamp_ns, block_ns))


@compiled
def _sticky_uniforms(seed: np.uint64, identity: I64, stamp_ns: int, block_ns: int) -> F64:
    out = np.empty(len(identity))
    for i in range(len(identity)):
        own = mix(seed, identity[i])
        fresh = mix(own, stamp_ns)
        # each thing changes its mind at moments of its own
        block = mix(own, (stamp_ns + np.int64(unit(own) * block_ns)) // block_ns)
        out[i] = unit(mix(block, 1)) if unit(fresh) < _STICKY_SHARE else unit(mix(fresh, 1))
    return out


def detect(seen: Seen, ghosts: Seen, rates: F64, config: DetectorConfig, clock: Clock) -> Objects:
    """Detections in the ego frame, without velocities, best score first.

    The score is the probability that the detection is true, given its quality and all that could
    have been reported in this frame; so scores are calibrated by construction.

    Args:
        seen: true objects.
        ghosts: what could be imagined.
        rates: probability of each ghost.
        config: of the detector.
        clock: source of the draws.
    """
    chance = recall(seen, config)
    hit = np.flatnonzero(clock.uniforms(seen.id, 10) < chance)
    false = np.flatnonzero(clock.uniforms(ghosts.id, 20) < rates)
    rng = np.random.default_rng(np.random.SeedSequence(clock.seed, spawn_key=(30, clock.stamp_ns)))
    shape = _quality_shape(chance)
    quality = np.concatenate([rng.beta(*shape[:, hit]), rng.beta(*_GHOST_QUALITY, size=len(false))])
    score = _posterior(quality, (chance, shape), rates)
    found = [_blurred(seen, hit, config, rng), _blurred(ghosts, false, config, rng)]
    centre, size, yaw, label = (np.concatenate(pair) for pair in zip(*found, strict=True))
    order = np.argsort(-score, kind="stable")
    return Objects(
        stamp_ns=clock.stamp_ns,
        frame="ego",
        centre_m=centre[order],
        size_m=size[order],
        yaw_rad=wrap_angle(yaw[order]),
        label=label[order],
        score=score[order],
    )


def _quality_shape(chance: F64) -> F64:
    """(2, N) beta parameters of the quality of true detections: easy objects look better."""
    return np.stack([1.5 + 5.0 * chance, np.full(len(chance), 1.8)])


def _posterior(
    quality: F64,
    true: tuple[F64, F64],
    rates: F64,
) -> F64:
    """(D,) P(true | quality) by Bayes over everything that could have been reported."""
    chance, shape = true
    q = np.clip(quality, 1e-6, 1.0 - 1e-6)[:, None]
    right = (chance * beta.pdf(q, shape[0], shape[1])).sum(axis=1)
    wrong = rates.sum() * beta.pdf(q[:, 0], *_GHOST_QUALITY)
    return np.asarray(right / np.maximum(right + wrong, 1e-12))


def _blurred(
    seen: Seen, rows: I64, config: DetectorConfig, rng: np.random.Generator
) -> tuple[F64, F64, F64, Texts]:
    """Centre, size, heading and label with noise that grows as the returns get fewer."""
    size, n = seen.size_m[rows], len(rows)
    few = 1.0 / np.sqrt(np.maximum(seen.num_points[rows], 1))
    spread = config.noise * (0.06 + 0.25 * few)[:, None] * [1.0, 1.0, 0.5]
    length_share = np.minimum(size[:, :1] / 4.5, 2.0) ** 0.5
    centre = seen.centre_m[rows] + np.clip(rng.normal(size=(n, 3)), -3, 3) * spread * length_share
    stretch = config.noise * (0.03 + 0.08 * few)[:, None]
    fuzzy = size * np.exp(np.clip(rng.normal(size=(n, 3)), -3, 3) * stretch)
    round_thing = np.where(np.isin(seen.label[rows], ["pedestrian"]), 4.0, 1.0)
    yaw = seen.yaw_rad[rows] + rng.normal(size=n) * config.noise * (0.03 + 0.12 * few) * round_thing
    yaw = yaw + np.pi * (rng.random(n) < config.flips * round_thing)
    return centre, fuzzy, yaw, seen.label[rows]

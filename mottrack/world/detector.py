"""A model of an object detector: recall, noise of boxes, false positives and scores.

Its numbers are chosen by eye to resemble a good nuScenes detector of 2020: best recall by class,
box errors of a few decimetres, a handful of false positives a frame. They are fitted to none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import SECOND_NS
from mottrack.world.catalogue import KINDS, TRACKED
from mottrack.world.config import DetectorConfig
from mottrack.world.hashing import random_bits, uniform


class _Recall(NamedTuple):
    best: float
    """Of objects nearby with many returns."""
    half_points: float
    """Number of returns at which half of that is found."""
    false_share: float
    """Of the false positives, that have this class."""


_CLASSES = {
    "bicycle": _Recall(0.82, 4.5, 0.12),
    "bus": _Recall(0.93, 8.0, 0.03),
    "car": _Recall(0.96, 4.0, 0.32),
    "motorcycle": _Recall(0.88, 4.0, 0.08),
    "pedestrian": _Recall(0.9, 3.5, 0.33),
    "trailer": _Recall(0.85, 10.0, 0.04),
    "truck": _Recall(0.9, 8.0, 0.08),
}
_POINTS_POWER = 1.3  # Recall rises a little faster with returns than by independent chances
_RANGE_FADE, _RANGE_START = 0.75, 1.15
"""Recall is flat up to 45 % of the range and down to 40 % of it at its end."""
_CORRELATED_SHARE, _CORRELATION_S = 0.6, 0.8
"""Share of draws that stay the same within a block of time: what is missed is missed again."""
# purposes of draws
_FOUND, _IMAGINED, _NOISE = 10, 20, 30
# beta distributions of the quality of a detection: easy objects look better, false ones poor
_TRUE_BASE, _TRUE_RISE, _TRUE_B = 1.5, 5.0, 1.8
_FALSE_QUALITY = (1.6, 4.0)
_FALSE_RATE = (0.8, 2.5)
"""Beta distribution of the probability that a site is reported: 0.24 in the mean, few often."""
_MOST_DEVIATIONS = 3
# deviations at a large number of returns and, in addition, at a single one
_CENTRE_M, _FEW_CENTRE_M = 0.06, 0.25
_LOG_SIZE, _FEW_LOG_SIZE = 0.03, 0.08
_YAW_RAD, _FEW_YAW_RAD = 0.03, 0.12
_ROUND_FACTOR = 4.0  # The heading of a pedestrian is worse known than that of a vehicle
_REFERENCE_LENGTH_M = 4.5
"""Centres of longer objects than a car err more, by the root of the length up to 1.4 times."""


@dataclass(frozen=True)
class FalsePositiveSites:
    """G places where the detector tends to see something that is not there."""

    xy_m: F64
    floor_m: F64
    yaw_rad: F64
    size_m: F64
    label: Texts
    rate: F64
    """(G,) probability to be reported in a frame, when near."""


@dataclass(frozen=True)
class Visible:
    """N objects of the known classes around the sensor at one stamp, ego frame."""

    centre_m: F64
    size_m: F64
    yaw_rad: F64
    label: Texts
    id: I64
    num_points: I64


def recall(visible: Visible, config: DetectorConfig) -> F64:
    """Return (N,) the recall of each object: it falls with range and with few returns."""
    best = np.array([_CLASSES[name].best for name in visible.label])
    half = np.array([_CLASSES[name].half_points for name in visible.label])
    points = visible.num_points / np.maximum(half, 1.0)
    away = np.hypot(visible.centre_m[:, 0], visible.centre_m[:, 1])
    fade: F64 = np.clip(_RANGE_START - (away / config.max_range_m) ** 2 * _RANGE_FADE, 0.0, 1.0)
    found = best * (1.0 - 0.5 ** (points**_POINTS_POWER)) * fade * (away < config.max_range_m)
    probability: F64 = np.clip(found * config.recall, 0.0, 0.99)
    return probability


def draw_false_positive_sites(
    rng: np.random.Generator, count: int, places: F64
) -> FalsePositiveSites:
    """Draw sites at ``count`` of the (K, 4) places x, y, floor, yaw."""
    count = min(count, len(places))
    chosen = places[rng.choice(len(places), count, replace=False)] if count else places[:0]
    shares = [_CLASSES[name].false_share for name in TRACKED]
    label = rng.choice(np.array(TRACKED), size=count, p=shares)
    mean = np.array([KINDS[name].mean_size for name in label])
    size = mean.reshape(count, 3) * rng.uniform(0.75, 1.1, (count, 3))
    yaw = chosen[:, 3] + rng.normal(0.0, 0.4, count)
    rate = rng.beta(*_FALSE_RATE, count)
    return FalsePositiveSites(chosen[:, :2], chosen[:, 2], yaw, size, label, rate)


@dataclass(frozen=True)
class FrameDraws:
    """Random numbers of one frame, correlated with those of the frames before."""

    seed: int
    stamp_ns: int

    def uniforms(self, identity: I64, purpose: int) -> F64:
        """Return (N,) uniform numbers, the same over _CORRELATION_S for most of the time."""
        block_ns = round(SECOND_NS * _CORRELATION_S)
        start = np.uint64(self.seed * 64 + purpose)
        return _correlated_uniforms(start, identity, self.stamp_ns, block_ns)


@compiled
def _correlated_uniforms(seed: np.uint64, identity: I64, stamp_ns: int, block_ns: int) -> F64:
    out = np.empty(len(identity))
    for i in range(len(identity)):
        own = random_bits(seed, identity[i])
        fresh = random_bits(own, stamp_ns)
        # the blocks of each object begin at times of its own
        block = random_bits(own, (stamp_ns + np.int64(uniform(own) * block_ns)) // block_ns)
        kept = uniform(fresh) < _CORRELATED_SHARE
        out[i] = uniform(random_bits(block if kept else fresh, 1))
    return out


def detect(
    visible: Visible, imagined: Visible, rates: F64, config: DetectorConfig, draws: FrameDraws
) -> Objects:
    """Return detections in the ego frame, without velocities, best score first.

    The score is the probability that the detection is true, given its quality and all that could
    have been reported in this frame; so scores are calibrated by construction.

    Args:
        visible: true objects.
        imagined: possible false positives.
        rates: probability of each of them.
        config: of the detector.
        draws: random numbers of the frame.
    """
    chance = recall(visible, config)
    hit = np.flatnonzero(draws.uniforms(visible.id, _FOUND) < chance)
    false = np.flatnonzero(draws.uniforms(imagined.id, _IMAGINED) < rates)
    source = np.random.SeedSequence(draws.seed, spawn_key=(_NOISE, draws.stamp_ns))
    rng = np.random.default_rng(source)
    shape = np.stack([_TRUE_BASE + _TRUE_RISE * chance, np.full(len(chance), _TRUE_B)])
    quality = np.concatenate([rng.beta(*shape[:, hit]), rng.beta(*_FALSE_QUALITY, size=len(false))])
    score = _posterior(quality, chance, shape, rates)
    found = [_with_noise(visible, hit, config, rng), _with_noise(imagined, false, config, rng)]
    order = np.argsort(-score, kind="stable")
    return Objects(
        stamp_ns=draws.stamp_ns,
        frame="ego",
        centre_m=np.concatenate([f.centre_m for f in found])[order],
        size_m=np.concatenate([f.size_m for f in found])[order],
        yaw_rad=wrap_angle(np.concatenate([f.yaw_rad for f in found])[order]),
        label=np.concatenate([f.label for f in found])[order],
        score=score[order],
    )


def _posterior(quality: F64, chance: F64, shape: F64, rates: F64) -> F64:
    """Return (D,) P(true | quality) by Bayes over everything that could have been reported."""
    q = np.clip(quality, 1e-6, 1.0 - 1e-6)[:, None]
    right: F64 = (chance * beta.pdf(q, shape[0], shape[1])).sum(axis=1)
    either: F64 = right + rates.sum() * beta.pdf(q[:, 0], *_FALSE_QUALITY)
    score: F64 = right / np.maximum(either, 1e-12)
    return score


def _with_noise(
    visible: Visible, rows: I64, config: DetectorConfig, rng: np.random.Generator
) -> Visible:
    """Return boxes with noise that grows as the returns get fewer."""
    size, n, most = visible.size_m[rows], len(rows), _MOST_DEVIATIONS
    few = 1.0 / np.sqrt(np.maximum(visible.num_points[rows], 1))
    # heights are known twice as well: the ground is seen
    spread = config.noise * (_CENTRE_M + _FEW_CENTRE_M * few)[:, None] * [1.0, 1.0, 0.5]
    longer = np.minimum(size[:, :1] / _REFERENCE_LENGTH_M, 2.0) ** 0.5
    error = np.clip(rng.normal(size=(n, 3)), -most, most) * spread * longer
    stretch = config.noise * (_LOG_SIZE + _FEW_LOG_SIZE * few)[:, None]
    fuzzy = size * np.exp(np.clip(rng.normal(size=(n, 3)), -most, most) * stretch)
    label = visible.label[rows]
    factor = np.where(label == "pedestrian", _ROUND_FACTOR, 1.0)
    yaw_error = rng.normal(size=n) * config.noise * (_YAW_RAD + _FEW_YAW_RAD * few) * factor
    flipped = np.pi * (rng.random(n) < config.flips * factor)
    yaw = visible.yaw_rad[rows] + yaw_error + flipped
    centre = visible.centre_m[rows] + error
    return Visible(centre, fuzzy, yaw, label, visible.id[rows], visible.num_points[rows])

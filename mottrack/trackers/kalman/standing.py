"""Two hypotheses of every track, it stands or it moves, and three of every measured velocity.

Most vehicles in a street are parked. A filter of constant velocity gives them the velocity of its
position noise, and a flow source that reads zero may be right or may have missed the motion. So a
track carries, beside its filter ("it moves"), the place where it would stand, a Gaussian that does
not move, and the probability p that it stands. A detection at z multiplies the odds of standing by

    N(z; place, P_place + R) / N(z; H x, H P H' + R),

so a creeping vehicle is told from a parked one by the way that it has come over all frames. A
measured velocity v with covariance R_d, which a moving track predicts as N(d, P), is

    of a standing object   (1 - p_outlier) N(v; 0, R_d)                  + p_outlier N(v; 0, G)
    of a moving object     p_correct N(v; d, P + R_d) + p_missed N(v; 0, R_d) + p_outlier N(v; 0, G)

with G the outliers' covariance plus R_d, and p_missed the share of motions that the source misses
at the track's speed (`core.velocity_errors`), averaged over N(d, P). The filter is corrected by v
with the probability w that v is correct if the object moves (Bar-Shalom's probabilistic data
association: mean and covariance of the mixture). The published velocity is that of the mixture,
(1 - p) d. A zero that misses the motion again and again leaves slow objects alone: their way tells.

Between frames a standing object starts at the rate `start_per_s`, and one whose velocity may be
zero stops at the rate `stop_per_s`. (Static and interacting multiple models: Blom and Bar-Shalom,
1988; here the standing model has no state but a place.)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import determinant_of, inverse_quadratic_of
from mottrack.trackers.kalman.config import StandingConfig

SMALLEST = 1e-200
"""Lower bound of a density: what no hypothesis explains changes no probability."""
SURE = 0.999
"""A velocity that is correct with this probability is taken for correct: a mixture of two states
for the rest would cost more time than the test of the source."""


class Failures(NamedTuple):
    """How velocities err, in the tracker's unit of time, as the kernels read it."""

    p_missed: float
    p_slow: float
    slow_speed: float
    p_outlier: float
    """Of moving objects."""
    outlier_variance: float
    p_outlier_standing: float
    rest_scale: float
    """Covariance of the velocities of standing objects over that of moving ones."""

    @classmethod
    def of(cls, model: VelocityErrorModel, unit_s: float) -> Failures:
        """Return the model's numbers; `unit_s` is the length of the unit of time in seconds."""
        return cls(
            float(model.p_missed_motion),
            float(model.p_missed_slow),
            model.missed_speed_mps * unit_s,
            float(model.p_outlier),
            (model.outlier_sigma_mps * unit_s) ** 2,
            float(model.p_outlier),
            1.0,
        )


class Hypotheses(NamedTuple):
    """Of N tracks; the kernels write to the arrays in place."""

    place: F64
    """(N, 2) where the track would stand, metres."""
    spread: F64
    """(N, 2, 2) its covariance."""
    p_standing: F64
    """(N,) probability that it stands."""


class Rates(NamedTuple):
    """Of changes between the hypotheses, and the speed near rest in the tracker's unit."""

    start_per_s: float
    stop_per_s: float
    rest_speed: float


def rates_of(config: StandingConfig, unit_s: float) -> Rates:
    """Return the rates of a configuration; `unit_s` is the length of the tracker's unit of time."""
    return Rates(config.start_per_s, config.stop_per_s, config.rest_mps * unit_s)


class Standing:
    """The hypotheses of all live tracks, row by row beside the bank."""

    def __init__(self, config: StandingConfig) -> None:
        self._config = config
        shapes = ((0, 2), (0, 2, 2), (0,))
        self.rows = Hypotheses(*(np.zeros(shape) for shape in shapes))

    def prior(self, label: list[str]) -> F64:
        """Return the probability (n,) that an object of each class stands, before it is seen."""
        if not self._config.use:
            return np.zeros(len(label))
        by_class = self._config.prior
        return np.array([by_class.get(name, self._config.other) for name in label], np.float64)

    def append(self, place: F64, spread: F64, p_standing: F64) -> None:
        """Add n tracks that would stand at `place` (n, 2) with covariance `spread` (n, 2, 2)."""
        new = (place, spread, p_standing)
        joined = (np.concatenate(pair) for pair in zip(self.rows, new, strict=True))
        self.rows = Hypotheses(*joined)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        self.rows = Hypotheses(*(part[mask] for part in self.rows))

    def predict(self, mean: F64, planar: F64, elapsed_s: F64, unit_s: float) -> None:
        """Let tracks start and stop within `elapsed_s` (N,).

        `mean` (N, 11) and `planar` (N, 4, 4) are the predicted filters; see `block_bank.Blocks`.
        """
        if self._config.use:
            change(self.rows, (mean, planar), elapsed_s, rates_of(self._config, unit_s))

    def observe_position(self, rows: I64, box: Observation, mean: F64, planar: F64) -> None:
        """Weigh positions of the tracks `rows` (n,), before the bank is corrected by them."""
        if self._config.use:
            weigh_position(self.rows, rows, box, (mean, planar))

    def observe_velocity(
        self, rows: I64, velocity: Observation, filters: tuple[F64, F64], failures: Failures
    ) -> F64:
        """Weigh velocities of the tracks `rows` (n,); return w (n,).

        `filters` are mean (N, 11) and planar (N, 4, 4), corrected by the positions of this step.
        """
        weight: F64 = _observe_velocity(self.rows, rows, velocity, filters, failures)
        return weight


class Observation(NamedTuple):
    """n measured vectors in the plane."""

    value: F64
    """(n, 2)"""
    covariance: F64
    """(n, 2, 2)"""


@compiled
def missed_share(failures: Failures, d: F64, p: F64) -> float:
    """Return p_missed of one track with velocity N(d, p).

    The mean of exp(-u^2 / 2 s^2) over u ~ N(d, p) is 2 pi s^2 N(d; 0, p + s^2 I).
    """
    s = failures.slow_speed**2
    xx, yy, xy = p[0, 0] + s, p[1, 1] + s, p[0, 1]
    determinant = xx * yy - xy * xy
    squared = (yy * d[0] * d[0] - 2.0 * xy * d[0] * d[1] + xx * d[1] * d[1]) / determinant
    slow = s / np.sqrt(determinant) * np.exp(-0.5 * squared)
    return float(failures.p_missed + failures.p_slow * slow)


@compiled
def normal_density(x: float, y: float, s: F64) -> float:
    """Return N((x, y); 0, s) for one covariance (2, 2)."""
    scale = 2.0 * np.pi * np.sqrt(determinant_of(s))
    return float(np.exp(-0.5 * inverse_quadratic_of(s, x, y)) / scale)


@compiled
def isotropic_density(v: F64, variance: float, s: F64) -> float:
    """Return N(v; 0, s + variance I) for one v (2,) and covariance s (2, 2)."""
    xx, yy, xy = s[0, 0] + variance, s[1, 1] + variance, s[0, 1]
    determinant = xx * yy - xy * xy
    squared = (yy * v[0] * v[0] - 2.0 * xy * v[0] * v[1] + xx * v[1] * v[1]) / determinant
    return float(np.exp(-0.5 * squared) / (2.0 * np.pi * np.sqrt(determinant)))


@compiled
def missed_shares(filters: tuple[F64, F64], failures: Failures) -> F64:
    """Return p_missed (N,) of tracks with mean (N, 11) and planar covariance (N, 4, 4)."""
    mean, planar = filters
    share = np.empty(len(mean))
    for n in range(len(mean)):
        share[n] = missed_share(failures, mean[n, 7:9], planar[n, 2:, 2:])
    return share


@compiled
def change(rows: Hypotheses, filters: tuple[F64, F64], elapsed_s: F64, rates: Rates) -> None:
    """Let tracks start and stop; `filters` are mean (N, 11) and planar (N, 4, 4), predicted."""
    mean, planar = filters
    rest = rates.rest_speed**2
    for n in range(len(rows.p_standing)):
        t = elapsed_s[n]
        if t <= 0.0:
            continue
        near_zero = 2.0 * np.pi * rest * isotropic_density(mean[n, 7:9], rest, planar[n, 2:, 2:])
        stays = rows.p_standing[n] * np.exp(-t * rates.start_per_s)
        stops = (1.0 - rows.p_standing[n]) * (1.0 - np.exp(-t * rates.stop_per_s)) * near_zero
        rows.p_standing[n] = stays + stops
        if stops <= 0.0:
            continue
        share = stops / (stays + stops)
        for k in range(2):
            for c in range(2):
                apart = (mean[n, k] - rows.place[n, k]) * (mean[n, c] - rows.place[n, c])
                mixed = (1.0 - share) * rows.spread[n, k, c] + share * planar[n, k, c]
                rows.spread[n, k, c] = mixed + share * (1.0 - share) * apart
        for k in range(2):
            rows.place[n, k] += share * (mean[n, k] - rows.place[n, k])


@compiled
def weigh_position(
    rows: Hypotheses, chosen: I64, seen: Observation, filters: tuple[F64, F64]
) -> None:
    """Weigh positions (n,) of the tracks `chosen` (n,), as `Standing.observe_position` does."""
    mean, planar = filters
    for i in range(len(chosen)):
        n, z = chosen[i], seen.value[i]
        p = rows.spread[n].copy()
        s = p + seen.covariance[i]
        x, y = z[0] - rows.place[n, 0], z[1] - rows.place[n, 1]
        stands = normal_density(x, y, s)
        moves = normal_density(
            z[0] - mean[n, 0], z[1] - mean[n, 1], planar[n, :2, :2] + seen.covariance[i]
        )
        _weigh(rows.p_standing, n, stands, moves)
        determinant = determinant_of(s)
        for k in range(2):
            gain_x = (p[k, 0] * s[1, 1] - p[k, 1] * s[0, 1]) / determinant
            gain_y = (p[k, 1] * s[0, 0] - p[k, 0] * s[0, 1]) / determinant
            rows.place[n, k] += gain_x * x + gain_y * y
            for c in range(2):
                rows.spread[n, k, c] = p[k, c] - gain_x * p[0, c] - gain_y * p[1, c]


@compiled
def _observe_velocity(
    rows: Hypotheses,
    chosen: I64,
    seen: Observation,
    filters: tuple[F64, F64],
    failures: Failures,
) -> F64:
    mean, planar = filters
    weight = np.ones(len(chosen))
    for i in range(len(chosen)):
        n, v, r = chosen[i], seen.value[i], seen.covariance[i]
        d, p = mean[n, 7:9], planar[n, 2:, 2:]
        p_missed = missed_share(failures, d, p)
        zero = normal_density(v[0], v[1], failures.rest_scale * r)
        wild = isotropic_density(v, failures.outlier_variance, r)
        outlier, at_rest = failures.p_outlier * wild, failures.p_outlier_standing * wild
        expected = normal_density(v[0] - d[0], v[1] - d[1], p + r)
        correct = (1.0 - p_missed - failures.p_outlier) * expected
        moves = correct + p_missed * zero + outlier
        _weigh(rows.p_standing, n, (1.0 - failures.p_outlier_standing) * zero + at_rest, moves)
        if p_missed > 0.0 or failures.p_outlier > 0.0:
            share = correct / max(moves, SMALLEST)
            weight[i] = share if share < SURE else 1.0
    return weight


@compiled
def _weigh(p: F64, n: int, stands: float, moves: float) -> None:
    """Apply Bayes' rule to the probability of standing of one track."""
    total = p[n] * stands + (1.0 - p[n]) * moves
    if total > SMALLEST:
        p[n] = p[n] * stands / total


@compiled
def velocity_likelihoods(
    seen: Observation, prior: F64, at_rest: float, failures: Failures
) -> F64:
    """Return four densities (4, n) of measured velocities, whichever track they belong to.

    The first is that of a missed motion, the second that of a moving object's outlier times its
    probability, the third that of an object that stands. The fourth is that of a new object: it
    stands with the probability `at_rest`, or moves by N(0, prior), with `prior` (n, 2, 2).
    """
    result = np.empty((4, len(prior)))
    d = np.zeros(2)
    for i in range(len(prior)):
        v, r = seen.value[i], seen.covariance[i]
        p_missed = missed_share(failures, d, prior[i])
        zero = normal_density(v[0], v[1], failures.rest_scale * r)
        wild = isotropic_density(v, failures.outlier_variance, r)
        outlier = failures.p_outlier * wild
        stands = (1.0 - failures.p_outlier_standing) * zero + failures.p_outlier_standing * wild
        new = normal_density(v[0], v[1], prior[i] + r)
        result[0, i], result[1, i] = zero, outlier
        moves = (1.0 - p_missed - failures.p_outlier) * new + p_missed * zero + outlier
        result[2, i] = stands
        result[3, i] = max(at_rest * stands + (1.0 - at_rest) * moves, SMALLEST)
    return result

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
from mottrack.geometry.two_by_two import (
    block_of,
    row_times_inverse,
    scaled,
    sum_of,
)
from mottrack.trackers.kalman.config import StandingConfig
from mottrack.trackers.kalman.moments import Moments
from mottrack.trackers.kalman.observations import Matched, Observation
from mottrack.trackers.velocity_source.failures import (
    SMALLEST,
    Failures,
    isotropic_density,
    missed_share,
    normal_density,
)

SURE = 0.999
"""A velocity that is correct with this probability is taken for correct: a mixture of two states
for the rest would cost more time than the test of the source."""


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

    def predict(self, filters: tuple[F64, F64], elapsed_s: F64, unit_s: float) -> None:
        """Let tracks start and stop within `elapsed_s` (N,); `filters` are the predicted ones."""
        if self._config.use:
            change(self.rows, filters, elapsed_s, rates_of(self._config, unit_s))

    def observe_position(
        self, matched: Matched, seen: Observation, filters: tuple[F64, F64]
    ) -> None:
        """Weigh positions of matched tracks, before the bank is corrected by them."""
        if self._config.use:
            weigh_position(self.rows, matched, seen, filters)

    def observe_velocity(
        self, rows: I64, velocity: Observation, filters: tuple[F64, F64], failures: Failures
    ) -> F64:
        """Weigh velocities of the tracks `rows` (n,); return w (n,).

        `filters` are mean (N, 11) and planar (N, 4, 4), corrected by the positions of this step.
        """
        return _observe_velocity(self.rows, rows, velocity, filters, failures)

    def velocities(self, rows: I64, filters: tuple[F64, F64]) -> Moments:
        """Return the velocities of `rows` (n,), of both hypotheses together."""
        return Moments(*_mixed_velocities(self.rows.p_standing, rows, filters))


@compiled
def change(rows: Hypotheses, filters: tuple[F64, F64], elapsed_s: F64, rates: Rates) -> None:
    """Let tracks start and stop; `filters` are mean (N, 11) and planar (N, 4, 4), predicted."""
    mean, planar = filters
    rest = rates.rest_speed**2
    for n in range(len(rows.p_standing)):
        t = elapsed_s[n]
        if t <= 0.0:
            continue
        density = isotropic_density(mean[n, 7], mean[n, 8], rest, block_of(planar, n, 2))
        near_zero = 2.0 * np.pi * rest * density
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
    rows: Hypotheses, matched: Matched, seen: Observation, filters: tuple[F64, F64]
) -> None:
    """Weigh positions of matched tracks, as `Standing.observe_position` does."""
    mean, planar = filters
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        r = block_of(seen.covariance, i, 0)
        z_x, z_y = seen.value[i, 0], seen.value[i, 1]
        p = block_of(rows.spread, n, 0)
        s = sum_of(p, r)
        x, y = z_x - rows.place[n, 0], z_y - rows.place[n, 1]
        expected = sum_of(block_of(planar, n, 0), r)
        moves = normal_density(z_x - mean[n, 0], z_y - mean[n, 1], expected)
        _weigh(rows.p_standing, n, normal_density(x, y, s), moves)
        for k in range(2):
            row_x, row_y = (p.xx, p.xy) if k == 0 else (p.xy, p.yy)
            gain_x, gain_y = row_times_inverse(row_x, row_y, s)
            rows.place[n, k] += gain_x * x + gain_y * y
            rows.spread[n, k, 0] = row_x - gain_x * p.xx - gain_y * p.xy
            rows.spread[n, k, 1] = row_y - gain_x * p.xy - gain_y * p.yy


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
        n, r = chosen[i], block_of(seen.covariance, i, 0)
        x, y, d_x, d_y = seen.value[i, 0], seen.value[i, 1], mean[n, 7], mean[n, 8]
        p = block_of(planar, n, 2)
        p_missed = missed_share(failures, d_x, d_y, p)
        zero = normal_density(x, y, scaled(r, failures.rest_scale))
        wild = isotropic_density(x, y, failures.outlier_variance, r)
        outlier, at_rest = failures.p_outlier * wild, failures.p_outlier_standing * wild
        expected = normal_density(x - d_x, y - d_y, sum_of(p, r))
        correct = (1.0 - p_missed - failures.p_outlier) * expected
        moves = correct + p_missed * zero + outlier
        _weigh(rows.p_standing, n, (1.0 - failures.p_outlier_standing) * zero + at_rest, moves)
        if p_missed > 0.0 or failures.p_outlier > 0.0:
            share = correct / max(moves, SMALLEST)
            weight[i] = share if share < SURE else 1.0
    return weight


@compiled
def _mixed_velocities(p_standing: F64, rows: I64, filters: tuple[F64, F64]) -> tuple[F64, F64]:
    """Return mean (n, 2) and covariance (n, 2, 2) of 0 with p_standing, else of N(d, P)."""
    mean, planar = filters
    velocity, covariance = np.empty((len(rows), 2)), np.empty((len(rows), 2, 2))
    for i in range(len(rows)):
        n = rows[i]
        p = 1.0 - p_standing[n]
        for k in range(2):
            velocity[i, k] = p * mean[n, k + 7]
            for c in range(2):
                apart = (1.0 - p) * mean[n, k + 7] * mean[n, c + 7]
                covariance[i, k, c] = p * (planar[n, k + 2, c + 2] + apart)
    return velocity, covariance


@compiled
def _weigh(p: F64, n: int, stands: float, moves: float) -> None:
    """Apply Bayes' rule to the probability of standing of one track."""
    total = p[n] * stands + (1.0 - p[n]) * moves
    if total > SMALLEST:
        p[n] = p[n] * stands / total


@compiled
def velocity_likelihoods(seen: Observation, prior: F64, at_rest: float, failures: Failures) -> F64:
    """Return four densities (4, n) of measured velocities, whichever track they belong to.

    The first is that of a missed motion, the second that of a moving object's outlier times its
    probability, the third that of an object that stands. The fourth is that of a new object: it
    stands with the probability `at_rest`, or moves by N(0, prior), with `prior` (n, 2, 2).
    """
    result = np.empty((4, len(prior)))
    for i in range(len(prior)):
        x, y, r = seen.value[i, 0], seen.value[i, 1], block_of(seen.covariance, i, 0)
        p = block_of(prior, i, 0)
        p_missed = missed_share(failures, 0.0, 0.0, p)
        zero = normal_density(x, y, scaled(r, failures.rest_scale))
        wild = isotropic_density(x, y, failures.outlier_variance, r)
        outlier = failures.p_outlier * wild
        stands = (1.0 - failures.p_outlier_standing) * zero + failures.p_outlier_standing * wild
        new = normal_density(x, y, sum_of(p, r))
        result[0, i], result[1, i] = zero, outlier
        moves = (1.0 - p_missed - failures.p_outlier) * new + p_missed * zero + outlier
        result[2, i] = stands
        result[3, i] = max(at_rest * stands + (1.0 - at_rest) * moves, SMALLEST)
    return result

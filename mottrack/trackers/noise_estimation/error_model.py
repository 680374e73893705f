"""Maximum-likelihood estimate of how a source of velocities errs, and R_d by class.

Each measured velocity v of an object of velocity u, with the covariance R that the source states
(and the tracker's floor), is a draw from

    p_correct N(v; u, R + r^2 v v^T) + p_missed(u) N(v; 0, R) + p_outlier N(v; 0, R + s^2 I),

the law by which the tracker weighs it (`kalman.standing`); p_missed falls with the speed, as
`core.velocity_errors` says. Of an object that stands the first two terms are one. R_d of a class is
the mean square of its errors over both axes, movers and gross errors included: the filter that uses
it has no other defence. The persistence is the correlation of the normalised errors of a mover from
one velocity to the next, missed motions and outliers included, but cut off at `LARGEST_ERROR`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import InputError
from mottrack.core.motion import MOVING_MPS
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.geometry.two_by_two import density_2x2, root_information_2x2
from mottrack.trackers.kalman.config import VelocityConfig

LEAST_COUNT = 20
"""A class with fewer velocities has no R_d of its own: it would be off by a third."""
STARTS = tuple(itertools.product((0.01, 0.3), (0.05, 0.5), (0.01, 0.1)))
"""First guesses of r, the missed share of slow motion and p_outlier: a share of the speed and
outliers explain the same gross errors, so the likelihood has several maxima."""
MOST_FAILURES = 0.95
"""Upper bound of the shares' sum: near rest a missed motion looks like a correct velocity."""
MOST_STEPS = 3000
"""Of the search, per start: six numbers take a few hundred."""
FIRST_MISSED, FIRST_SPEED_MPS, FIRST_SIGMA_MPS = 0.05, 1.5, 2.0
"""First guesses of the other numbers; no start is far from them."""
SPEEDS_MPS = (0.3, 10.0)
"""Bounds of the two speeds of the model: within R, and beyond every urban speed difference."""
LARGEST_ERROR = 3.0
"""Standard deviations at which errors are cut off, so that a few gross ones do not decide."""
MOST_PERSISTENCE = 0.95
"""Beyond it the second velocity of an object would tell nothing; it tells at least of turns."""
SMALLEST = 1e-200
"""Lower bound of a likelihood whose logarithm is taken."""
ALL = "all"
"""Name of R_d over every class, which classes without one of their own get."""


@dataclass(frozen=True, slots=True)
class VelocitySample:
    """N measured velocities with their truth, world axes."""

    label: Texts
    """(N,) class."""
    measured_mps: F64
    """(N, 2)"""
    covariance_m2ps2: F64
    """(N, 2, 2) as the source states it."""
    true_mps: F64
    """(N, 2)"""
    object: I64
    """(N,) which object; rows of one are in order of time."""

    @classmethod
    def stacked(cls, parts: Sequence[VelocitySample]) -> VelocitySample:
        """Return the samples of all parts, in order."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in cls.__slots__))

    @property
    def consistency(self) -> float:
        """Mean of e' R^-1 e / 2: 1 where the covariance that the source states is right."""
        error = self.measured_mps - self.true_mps
        stated = self.covariance_m2ps2 + VelocityConfig().floor_mps ** 2 * np.eye(2)
        solved = np.linalg.solve(stated, error[:, :, None])[:, :, 0]
        return float(np.mean(np.sum(error * solved, axis=1)) / 2.0)


def fit_error_model(sample: VelocitySample) -> VelocityErrorModel:
    """Return the error model under which the samples are likeliest, with R_d by class.

    Raises:
        InputError: there are fewer than `LEAST_COUNT` velocities.
    """
    # only the study of errors needs it, and it loads slowly
    from scipy.optimize import minimize

    if len(sample.label) < LEAST_COUNT:
        raise InputError("measured velocities", len(sample.label), f"at least {LEAST_COUNT}")

    def cost(root: F64) -> float:
        return _cost(root**2, sample)

    rest = FIRST_MISSED, FIRST_SPEED_MPS, FIRST_SIGMA_MPS
    guesses = (np.sqrt(np.array([*start, *rest])) for start in STARTS)
    found = [
        minimize(cost, guess, method="Nelder-Mead", options={"maxiter": MOST_STEPS})
        for guess in guesses
    ]
    best = min(found, key=lambda result: float(result.fun))
    numbers = (round(float(value), 3) for value in best.x**2)
    relative, slow, outlier, missed, speed_mps, sigma_mps = numbers
    shares = relative, missed, slow, speed_mps, outlier, sigma_mps
    return VelocityErrorModel(*shares, class_variances(sample), persistence(sample))


def persistence(sample: VelocitySample) -> float:
    """Return the correlation of the errors of successive velocities of movers, 0 of too few."""
    stated = sample.covariance_m2ps2 + VelocityConfig().floor_mps ** 2 * np.eye(2)
    error = sample.measured_mps - sample.true_mps
    normalised = np.einsum("nij,nj->ni", root_information_2x2(stated), error)
    normalised = np.clip(normalised, -LARGEST_ERROR, LARGEST_ERROR)
    order = np.argsort(sample.object, kind="stable")
    moves = np.hypot(*sample.true_mps.T)[order] >= MOVING_MPS
    same = np.diff(sample.object[order]) == 0
    pairs = np.flatnonzero(same & moves[1:] & moves[:-1])
    if len(pairs) < LEAST_COUNT:
        return 0.0
    then, now = normalised[order[pairs]], normalised[order[pairs + 1]]
    correlation = 2.0 * np.sum(now * then) / max(np.sum(now**2 + then**2), SMALLEST)
    return round(float(np.clip(correlation, 0.0, MOST_PERSISTENCE)), 3)


def class_variances(sample: VelocitySample) -> tuple[tuple[str, float], ...]:
    """Return pairs of class and R_d in (m/s)^2, of one axis; the last is that of all classes."""
    square = 0.5 * np.sum((sample.measured_mps - sample.true_mps) ** 2, axis=1)
    pairs = [
        (str(label), round(float(square[sample.label == label].mean()), 4))
        for label in np.unique(sample.label)
        if np.count_nonzero(sample.label == label) >= LEAST_COUNT
    ]
    return (*pairs, (ALL, round(float(square.mean()), 4)))


def _cost(parameters: F64, sample: VelocitySample) -> float:
    """Return the negative log-likelihood per sample; inf outside the simplex."""
    relative, slow, outlier, missed, speed_mps, sigma_mps = parameters
    low, high = SPEEDS_MPS
    if missed + slow + outlier > MOST_FAILURES or not low <= min(speed_mps, sigma_mps):
        return float("inf")
    if max(speed_mps, sigma_mps) > high:
        return float("inf")
    config, v = VelocityConfig(), sample.measured_mps
    stated = sample.covariance_m2ps2 + config.floor_mps**2 * np.eye(2)
    spread = stated + relative**2 * v[:, :, None] * v[:, None, :]
    true_mps = np.hypot(*sample.true_mps.T)
    lost = missed + slow * np.exp(-0.5 * (true_mps / speed_mps) ** 2)
    lost[true_mps < MOVING_MPS] = 0.0
    likelihood = (1.0 - lost - outlier) * density_2x2(v - sample.true_mps, spread)
    likelihood += lost * density_2x2(v, stated)
    likelihood += outlier * density_2x2(v, stated + sigma_mps**2 * np.eye(2))
    return float(-np.mean(np.log(np.maximum(likelihood, SMALLEST))))

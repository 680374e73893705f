"""The filter's noise, estimated from detections and truth.

After Chiu et al. (2020), section III-C, in real time, with angles wrapped and gross errors left
out: R is the spread of the detector's errors, P0 that of the first state about zero velocity, Q
follows from how the truth accelerates, and R_d is the spread of a source's velocity errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.trackers.kalman.config import ClassNoise
from mottrack.trackers.kalman.default_noise import SIZE_M2PS, WANDER_M2PS, WANDER_RAD2PS
from mottrack.trackers.kalman.pair_cost import heading_residual
from mottrack.trackers.noise_estimation.samples import Pairs

OUTLIER_SIGMA = 5.0
"""Errors beyond this many robust standard deviations are no noise but mistakes."""
BASELINE_S = 0.45
"""Accelerations are taken over at least this long, or the annotators' jitter would count."""
LEAST_COUNT = 20
"""A class with fewer pairs keeps the noise it had."""
MAD_TO_SIGMA = 1.4826
SMALLEST_VARIANCE = 1e-4


@dataclass(frozen=True, slots=True)
class ClassEstimate:
    """Noise of one class and what it rests on."""

    noise: ClassNoise
    pairs: int
    """Detections matched with the truth."""
    outliers: int
    """Of those, errors left out of at least one variance."""
    accelerations: int
    """True accelerations."""


@dataclass(frozen=True, slots=True)
class VelocityEstimate:
    """R_d of a velocity source: one variance for both axes, which turn with the object."""

    variance_m2ps2: float
    measured: int
    outliers: int
    bias_mps: tuple[float, float]


def estimate_noise(pairs: Pairs) -> dict[str, ClassEstimate]:
    """R, P0 and Q of every class with at least `LEAST_COUNT` pairs and accelerations.

    Raises:
        InputError: no class has enough of both.
    """
    found = {}
    for label in np.unique(pairs.label).tolist():
        estimate = _estimate_class(pairs, label)
        if estimate is not None:
            found[label] = estimate
    if not found:
        counts = {c: int((pairs.label == c).sum()) for c in np.unique(pairs.label).tolist()}
        expected = f"at least {LEAST_COUNT} pairs and as many accelerations of one class"
        raise InputError("pairs by class", counts, expected)
    return found


def estimate_velocity_noise(pairs: Pairs) -> VelocityEstimate | None:
    """R_d of the source whose velocities the pairs carry; none where it measured too little."""
    error = pairs.velocity_error[np.isfinite(pairs.velocity_error).all(axis=1)]
    if len(error) < LEAST_COUNT:
        return None
    good = inliers(error[:, 0]) & inliers(error[:, 1])
    variance = float(np.mean(error[good] ** 2))
    bias = error[good].mean(axis=0)
    return VelocityEstimate(
        max(variance, SMALLEST_VARIANCE),
        len(error),
        int((~good).sum()),
        (float(bias[0]), float(bias[1])),
    )


def inliers(error: F64) -> Mask:
    """Errors (N,) within `OUTLIER_SIGMA` of their median, the sigma from the median deviation."""
    deviation = np.abs(error - np.median(error))
    return np.asarray(deviation <= OUTLIER_SIGMA * MAD_TO_SIGMA * np.median(deviation) + 1e-12)


def _estimate_class(pairs: Pairs, label: str) -> ClassEstimate | None:
    mine = pairs.label == label
    error = _body_errors(pairs.detection[mine], pairs.truth[mine])
    change = _changes(pairs, label)
    if len(error) < LEAST_COUNT or len(change.acceleration) < LEAST_COUNT:
        return None
    good = np.stack([inliers(column) for column in error.T], axis=1)
    variance = np.array([np.var(e[g]) for e, g in zip(error.T, good.T, strict=True)])
    variance = np.maximum(variance, SMALLEST_VARIANCE)
    across, along = float(variance[1]), float(max(variance[0], variance[1]))
    observation = (across, across, *variance[2:].tolist())
    noise = ClassNoise(
        observation=observation,
        initial=observation + change.initial_rates(),
        process=change.process(),
        along_ratio=float(np.sqrt(along / across)),
        across_ratio=change.across_ratio(observation[3]),
    )
    outliers = int((~good.all(axis=1)).sum())
    return ClassEstimate(noise, len(error), outliers, len(change.acceleration))


def _body_errors(detection: F64, truth: F64) -> F64:
    """Errors (N, 7) with x, y along and across the true heading, and headings modulo pi."""
    error = detection - truth
    error[:, 3] = heading_residual(error[:, 3])
    return _turned_to_body(error, truth[:, 3])


@dataclass(frozen=True, slots=True)
class _Changes:
    """How the true boxes of a class move: rates and accelerations of x, y, z, yaw.

    White noise of density q on the rate changes the mean rates of two neighbouring intervals by a
    variance of q (t1 + t2) / 3.
    """

    rate: F64
    """(K, 4), x and y along and across the heading."""
    acceleration: F64
    """(K, 4) change of the rate, over the root of (t1 + t2) / 3."""

    def initial_rates(self) -> tuple[float, ...]:
        """Variances of d_x, d_y, d_z, d_yaw of a new track, about zero."""
        square = np.maximum(np.mean(self.rate**2, axis=0), SMALLEST_VARIANCE)
        speed = float(max(square[0], square[1]))
        return (speed, speed, float(square[2]), float(square[3]))

    def across_ratio(self, yaw_variance: float) -> float:
        """Spread of the velocity across the heading over that along it.

        A track is born with the detected heading: its error turns some of the speed across.
        """
        square = np.maximum(np.mean(self.rate**2, axis=0), SMALLEST_VARIANCE)
        return float(min(1.0, np.sqrt(square[1] / square[0] + yaw_variance)))

    def process(self) -> tuple[float, ...]:
        """Q of box and rates per second."""
        push = np.maximum(np.mean(self.acceleration**2, axis=0), SMALLEST_VARIANCE)
        planar = float(0.5 * (push[0] + push[1]))
        wander = (WANDER_M2PS, WANDER_M2PS, WANDER_M2PS, WANDER_RAD2PS)
        return (*wander, *[SIZE_M2PS] * 3, planar, planar, float(push[2]), float(push[3]))


def _changes(pairs: Pairs, label: str) -> _Changes:
    rates, accelerations = [np.empty((0, 4))], [np.empty((0, 4))]
    for rows in _tracks_of(pairs, label):
        picked = rows[_spaced(pairs.true_stamp_ns[rows])]
        if len(picked) < 3:
            continue
        step_s = np.diff(pairs.true_stamp_ns[picked])[:, None] * 1e-9
        box = pairs.true_box[picked]
        difference = np.diff(box[:, :4], axis=0)
        difference[:, 3] = heading_residual(difference[:, 3])
        rate = difference / step_s
        rates.append(_turned_to_body(rate, box[:-1, 3]))
        accelerations.append(np.diff(rate, axis=0) / np.sqrt((step_s[1:] + step_s[:-1]) / 3))
    return _Changes(np.concatenate(rates), np.concatenate(accelerations))


def _tracks_of(pairs: Pairs, label: str) -> list[I64]:
    """Rows of each true object of a class, in order of time."""
    rows = np.flatnonzero(pairs.true_label == label)
    order = rows[np.lexsort((pairs.true_stamp_ns[rows], pairs.true_object[rows]))]
    return np.split(order, np.flatnonzero(np.diff(pairs.true_object[order])) + 1)


def _spaced(stamp_ns: I64) -> list[int]:
    """Positions of stamps at least `BASELINE_S` apart, the first included."""
    picked = [0]
    for k, stamp in enumerate(stamp_ns.tolist()):
        if stamp - stamp_ns[picked[-1]] >= BASELINE_S * 1e9:
            picked.append(k)
    return picked


def _turned_to_body(rows: F64, yaw_rad: F64) -> F64:
    """The rows (N, D) with their first two numbers, x and y, along and across the headings."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    along, across = cos * rows[:, 0] + sin * rows[:, 1], cos * rows[:, 1] - sin * rows[:, 0]
    return np.column_stack([along, across, rows[:, 2:]])

"""Estimation of the filter's noise from detections and truth.

After Chiu et al. (2020), section III-C, in real time, with angles wrapped and gross errors left
out: R is the spread of the detector's errors, P0 that of the first state about zero velocity, Q
follows from how the truth accelerates, and R_d is the spread of a source's velocity errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.sweep import SECOND_NS, seconds_between
from mottrack.geometry.angles import heading_residual
from mottrack.trackers.kalman.config import ClassNoise
from mottrack.trackers.kalman.noise_tables import SIZE_M2PS, WANDER_M2PS, WANDER_RAD2PS
from mottrack.trackers.noise_estimation.samples import NoiseSamples

OUTLIER_SIGMA = 5.0
"""Errors beyond this many robust standard deviations are outliers, not noise."""
BASELINE_S = 0.45
"""Shortest interval for accelerations: over less, the annotators' jitter dominates."""
LEAST_COUNT = 20
"""A class with fewer samples keeps the noise it had: variances would be off by a third."""
MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal law over its median absolute deviation."""
CLEAR_SPEED_MPS = 1.0
"""The direction of slower motion is that of the annotators' jitter."""
SMALLEST_VARIANCE = 1e-4
"""(1 cm)^2: perfect detections of a simulation must not give a singular R."""


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
    """R_d of a velocity source: one variance for both axes, which turn with the object.

    No velocity is left out: those of movers err most, and the filter meets them too.
    """

    variance_m2ps2: float
    """Over all classes."""
    class_variance_m2ps2: dict[str, float]
    """Of each class with enough velocities."""
    measured: int
    bias_mps: tuple[float, float]


def estimate_noise(samples: NoiseSamples) -> dict[str, ClassEstimate]:
    """Estimate R, P0 and Q of every class with at least `LEAST_COUNT` pairs and accelerations.

    Raises:
        InputError: no class has enough of both.
    """
    found = {}
    for label in np.unique(samples.label).tolist():
        estimate = _estimate_class(samples, label)
        if estimate is not None:
            found[label] = estimate
    if not found:
        counts = {c: int((samples.label == c).sum()) for c in np.unique(samples.label).tolist()}
        expected = f"at least {LEAST_COUNT} pairs and as many accelerations of one class"
        raise InputError("pairs by class", counts, expected)
    return found


def estimate_velocity_noise(samples: NoiseSamples) -> VelocityEstimate | None:
    """Estimate R_d of the source of the velocities; None where there are too few."""
    error = samples.velocity_error[np.isfinite(samples.velocity_error).all(axis=1)]
    if len(error) < LEAST_COUNT:
        return None
    label = samples.label[np.isfinite(samples.velocity_error).all(axis=1)]
    square = 0.5 * np.sum(error**2, axis=1)
    by_class = {
        str(name): max(float(square[label == name].mean()), SMALLEST_VARIANCE)
        for name in np.unique(label)
        if np.count_nonzero(label == name) >= LEAST_COUNT
    }
    bias = error.mean(axis=0)
    whole = max(float(square.mean()), SMALLEST_VARIANCE)
    return VelocityEstimate(whole, by_class, len(error), (float(bias[0]), float(bias[1])))


def inliers(error: F64) -> Mask:
    """Return which errors (N,) lie within `OUTLIER_SIGMA` of their median, by their MAD."""
    deviation = np.abs(error - np.median(error))
    # 1e-12: errors that are all equal have a deviation of 0 and are inliers
    return np.asarray(deviation <= OUTLIER_SIGMA * MAD_TO_SIGMA * np.median(deviation) + 1e-12)


def _estimate_class(samples: NoiseSamples, label: str) -> ClassEstimate | None:
    mine = samples.label == label
    error = _body_errors(samples.detection[mine], samples.truth[mine])
    change = _changes(samples, label)
    if len(error) < LEAST_COUNT or len(change.acceleration) < LEAST_COUNT:
        return None
    good = np.stack([inliers(column) for column in error.T], axis=1)
    variance = np.array([np.var(e[g]) for e, g in zip(error.T, good.T, strict=True)])
    variance = np.maximum(variance, SMALLEST_VARIANCE)
    lateral, longitudinal = float(variance[1]), float(max(variance[0], variance[1]))
    observation = (lateral, lateral, *variance[2:].tolist())
    noise = ClassNoise(
        observation=observation,
        initial=observation + change.initial_rates(),
        process=change.process(),
        longitudinal_ratio=float(np.sqrt(longitudinal / lateral)),
        lateral_ratio=change.lateral_ratio(observation[3]),
        slip_rad=change.slip_rad(),
    )
    outliers = int((~good.all(axis=1)).sum())
    return ClassEstimate(noise, len(error), outliers, len(change.acceleration))


def _body_errors(detection: F64, truth: F64) -> F64:
    """Return errors (N, 7): x, y along and across the true heading, headings modulo pi."""
    error = detection - truth
    error[:, 3] = heading_residual(error[:, 3])
    return _in_body_axes(error, truth[:, 3])


@dataclass(frozen=True, slots=True)
class _Changes:
    """Rates and accelerations of x, y, z, yaw of the true boxes of a class.

    White noise of density q on the rate changes the mean rates of two neighbouring intervals by a
    variance of q (t1 + t2) / 3.
    """

    rate: F64
    """(K, 4), x and y along and across the heading."""
    acceleration: F64
    """(K, 4) change of the rate, over the root of (t1 + t2) / 3."""

    def initial_rates(self) -> tuple[float, ...]:
        """Return the variances of d_x, d_y, d_z, d_yaw of a new track, about zero."""
        square = np.maximum(np.mean(self.rate**2, axis=0), SMALLEST_VARIANCE)
        speed = float(max(square[0], square[1]))
        return (speed, speed, float(square[2]), float(square[3]))

    def lateral_ratio(self, yaw_variance: float) -> float:
        """Return the spread of the velocity across the heading over that along it.

        A track starts with the detected heading, whose error turns some of the speed sideways.
        """
        square = np.maximum(np.mean(self.rate**2, axis=0), SMALLEST_VARIANCE)
        return float(min(1.0, np.sqrt(square[1] / square[0] + yaw_variance)))

    def slip_rad(self) -> float:
        """Return the spread of the heading about the course of objects that clearly move."""
        moving = self.rate[np.hypot(self.rate[:, 0], self.rate[:, 1]) > CLEAR_SPEED_MPS]
        if len(moving) < LEAST_COUNT:
            return float(ClassNoise.model_fields["slip_rad"].default)
        slip = heading_residual(np.arctan2(moving[:, 1], moving[:, 0]))
        square = float(np.mean(slip[inliers(slip)] ** 2))
        return float(np.sqrt(max(square, SMALLEST_VARIANCE)))

    def process(self) -> tuple[float, ...]:
        """Return Q of box and rates per second."""
        push = np.maximum(np.mean(self.acceleration**2, axis=0), SMALLEST_VARIANCE)
        planar = float(0.5 * (push[0] + push[1]))
        wander = (WANDER_M2PS, WANDER_M2PS, WANDER_M2PS, WANDER_RAD2PS)
        return (*wander, *[SIZE_M2PS] * 3, planar, planar, float(push[2]), float(push[3]))


def _changes(samples: NoiseSamples, label: str) -> _Changes:
    rates, accelerations = [np.empty((0, 4))], [np.empty((0, 4))]
    for rows in _tracks_of(samples, label):
        picked = rows[_spaced(samples.true_stamp_ns[rows])]
        if len(picked) < 3:
            continue
        stamp_ns = samples.true_stamp_ns[picked]
        step_s = seconds_between(stamp_ns[:-1], stamp_ns[1:])[:, None]
        box = samples.true_box[picked]
        difference = np.diff(box[:, :4], axis=0)
        difference[:, 3] = heading_residual(difference[:, 3])
        rate = difference / step_s
        rates.append(_in_body_axes(rate, box[:-1, 3]))
        accelerations.append(np.diff(rate, axis=0) / np.sqrt((step_s[1:] + step_s[:-1]) / 3))
    return _Changes(np.concatenate(rates), np.concatenate(accelerations))


def _tracks_of(samples: NoiseSamples, label: str) -> list[I64]:
    """Return the rows of each true object of a class, in order of time."""
    rows = np.flatnonzero(samples.true_label == label)
    order = rows[np.lexsort((samples.true_stamp_ns[rows], samples.true_object[rows]))]
    return np.split(order, np.flatnonzero(np.diff(samples.true_object[order])) + 1)


def _spaced(stamp_ns: I64) -> list[int]:
    """Return positions of stamps at least `BASELINE_S` apart, the first included."""
    picked = [0]
    for k, stamp in enumerate(stamp_ns.tolist()):
        if stamp - stamp_ns[picked[-1]] >= BASELINE_S * SECOND_NS:
            picked.append(k)
    return picked


def _in_body_axes(rows: F64, yaw_rad: F64) -> F64:
    """Return rows (N, D) with their first two numbers, x and y, along and across the headings."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    longitudinal, lateral = cos * rows[:, 0] + sin * rows[:, 1], cos * rows[:, 1] - sin * rows[:, 0]
    return np.column_stack([longitudinal, lateral, rows[:, 2:]])

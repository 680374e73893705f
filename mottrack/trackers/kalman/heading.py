"""Two hypotheses of every track's heading, as its filter has it or turned by pi, and the course.

The filter compares headings modulo pi: detectors mistake front and rear. Which end is the front is
a probability p_turned beside it. A detected heading that differs from the filter's by e, whose
variance is S, lies on the filter's side with the von Mises odds exp(2 cos(e) / S), and the detector
turns a box with probability f:

    p(e | right) = (1 - f) same + f (1 - same),    p(e | turned) = f same + (1 - f) (1 - same).

f is estimated by class while the tracker runs: the mean of a Beta law, from the expected number of
turned detections. Road users drive forward but for a share `p_backwards` of the time, so the
velocity d ~ N(d, P) tells as well: with F = Phi(h'd / sqrt(h'P h)) the probability that it points
along the heading h, an object that moves does so with (1 - p_backwards) F + p_backwards (1 - F),
one that stands either way. And who moves points where it goes: the course atan2(d) is observed as a
heading modulo pi with variance n'P n / d'd + slip^2 (n across d), over the probability that the
track moves; near rest that is no observation at all. Velocities of successive steps are one
estimate carried on, so both count with 1 - exp(-dt / correlation_s) of their weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.geometry.angles import modulo_pi
from mottrack.geometry.two_by_two import block_of
from mottrack.trackers.kalman.config import HeadingConfig
from mottrack.trackers.kalman.observations import Matched, SeenBoxes
from mottrack.trackers.kalman.state import YAW

SMALLEST = 1e-12
"""Lower bound of probabilities, shares and squared speeds: nothing is divided by 0."""
LARGEST_VARIANCE = 1e6
"""(1000 rad)^2: an observation modulo pi that says nothing."""
LARGEST_ODDS = 30.0
"""Bound of a logarithm of odds: beyond it probabilities are 0 and 1 to the last bit."""


class DetectedHeadings(NamedTuple):
    """Of M detections."""

    boxes: SeenBoxes
    label: I64
    """(M,) index of the class."""


class TrackHeadings(NamedTuple):
    """Of N tracks, as they are predicted."""

    mean: F64
    """(N, 11)"""
    z_yaw_size_variance: F64
    """(N, 5)"""


class Motion(NamedTuple):
    """Of N tracks, corrected by the boxes of a step."""

    mean: F64
    """(N, 11)"""
    planar: F64
    """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
    p_standing: F64
    """(N,) probability that the track stands."""
    slip_rad: F64
    """(N,) standard deviation of the heading about the course."""


class Course(NamedTuple):
    """Headings observed from n velocities."""

    residual: F64
    """(n,) direction of motion less heading, modulo pi."""
    variance: F64
    """(n,) of that residual, without the heading's own."""


class TurnModel(NamedTuple):
    """What is known of detections and tracks before a step."""

    p_detection: F64
    """(K,) probability that a detection of each class is turned."""
    p_changed: float
    """Probability that a track came to be turned, or no longer is, since the last step."""
    turned: F64
    """(K,) expected number of turned detections by class, which the kernel adds to."""
    seen: F64
    """(K,) number of all, likewise."""


class Headings:
    """Probabilities of all live tracks that they are turned, row by row beside the bank."""

    def __init__(self, config: HeadingConfig) -> None:
        self._config = config
        self.p_turned = np.zeros(0)
        """(N,)"""
        self._turned = np.zeros(0)
        self._seen = np.zeros(0)

    def append(self, label: I64) -> None:
        """Add n tracks that were born at detections of these classes (n,)."""
        self.p_turned = np.concatenate([self.p_turned, self.p_detection_turned(label)])

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        self.p_turned = self.p_turned[mask]

    def p_detection_turned(self, label: I64) -> F64:
        """Return f (n,), the probability that a detection of each class is turned."""
        self._make_room(label)
        return self._by_class()[label]

    def observe_detections(
        self, matched: Matched, seen: DetectedHeadings, tracks: TrackHeadings, elapsed_s: float
    ) -> None:
        """Weigh detected headings of matched tracks, before the bank is corrected by them."""
        self._make_room(seen.label)
        # a track that took over another object may be turned: both ways at one rate
        changed = 0.5 * (1.0 - math.exp(-2.0 * self._config.switch_per_s * elapsed_s))
        model = TurnModel(self._by_class(), changed, self._turned, self._seen)
        _observe_detections(self.p_turned, matched, seen, tracks, model)

    def course(self, rows: I64, motion: Motion, share: float) -> Course:
        """Return the courses of the tracks `rows` (n,); `share` is the weight of the step."""
        return Course(*_course(rows, motion, share))

    def observe_motion(self, rows: I64, motion: Motion, share: float) -> I64:
        """Weigh the velocities of `rows` (n,) and return the rows that are to be turned.

        `share` is the weight of the step. The rows are taken as turned: their probabilities belong
        to the new headings.
        """
        turned = _observe_motion(self.p_turned, rows, motion, share, self._config.p_backwards)
        return np.asarray(rows[turned])

    def share(self, elapsed_s: float) -> float:
        """Return how much of a velocity estimate is new after a step."""
        return 1.0 - math.exp(-elapsed_s / self._config.correlation_s)

    def _by_class(self) -> F64:
        prior = self._config.prior_detections
        turned = self._turned + self._config.p_turned * prior
        return np.asarray(turned / (self._seen + prior))

    def _make_room(self, label: I64) -> None:
        missing = int(label.max(initial=-1)) + 1 - len(self._seen)
        if missing > 0:
            self._seen = np.concatenate([self._seen, np.zeros(missing)])
            self._turned = np.concatenate([self._turned, np.zeros(missing)])


@compiled
def _log_odds(p: float) -> float:
    return math.log(max(p, SMALLEST)) - math.log(max(1.0 - p, SMALLEST))


@compiled
def _probability(log_odds: float) -> float:
    bounded = min(max(log_odds, -LARGEST_ODDS), LARGEST_ODDS)
    return 1.0 / (1.0 + math.exp(-bounded))


@compiled
def _observe_detections(
    p_turned: F64,
    matched: Matched,
    seen: DetectedHeadings,
    tracks: TrackHeadings,
    model: TurnModel,
) -> None:
    box, noise = seen.boxes.box, seen.boxes.z_yaw_size_variance
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        c = seen.label[i]
        f = model.p_detection[c]
        p = p_turned[n] + (1.0 - 2.0 * p_turned[n]) * model.p_changed
        variance = tracks.z_yaw_size_variance[n, 1] + noise[i, 1]
        same = _probability(2.0 * math.cos(box[i, YAW] - tracks.mean[n, YAW]) / variance)
        right = (1.0 - f) * same + f * (1.0 - same)
        other = f * same + (1.0 - f) * (1.0 - same)
        p = _probability(_log_odds(p) + math.log(other / right))
        p_turned[n] = p
        model.turned[c] += (1.0 - p) * (1.0 - same) + p * same
        model.seen[c] += 1.0


@compiled
def _course(rows: I64, motion: Motion, share: float) -> tuple[F64, F64]:
    mean = motion.mean
    residual, variance = np.empty(len(rows)), np.empty(len(rows))
    for i in range(len(rows)):
        n = rows[i]
        x, y = mean[n, 7], mean[n, 8]
        square = x * x + y * y + SMALLEST
        # the spread across the direction of motion: (-y, x) P (-y, x)' over the square, twice
        p = block_of(motion.planar, n, 2)
        across = (y * y * p.xx - 2.0 * x * y * p.xy + x * x * p.yy) / square
        own = across / square + motion.slip_rad[n] ** 2
        moving = share * (1.0 - motion.p_standing[n])
        variance[i] = min(own / max(moving, SMALLEST), LARGEST_VARIANCE)
        residual[i] = modulo_pi(math.atan2(y, x) - mean[n, YAW])
    return residual, variance


@compiled
def _observe_motion(
    p_turned: F64, rows: I64, motion: Motion, share: float, backwards: float
) -> Mask:
    mean, turned = motion.mean, np.zeros(len(rows), np.bool_)
    for i in range(len(rows)):
        n = rows[i]
        p = block_of(motion.planar, n, 2)
        cos, sin = math.cos(mean[n, YAW]), math.sin(mean[n, YAW])
        along = cos * mean[n, 7] + sin * mean[n, 8]
        spread = cos * cos * p.xx + 2.0 * cos * sin * p.xy + sin * sin * p.yy
        forward = 0.5 * math.erfc(-along / math.sqrt(2.0 * spread))
        right = (1.0 - backwards) * forward + backwards * (1.0 - forward)
        still = motion.p_standing[n]
        moves = 1.0 - still
        odds = (0.5 * still + moves * (1.0 - right)) / (0.5 * still + moves * right)
        p_turned[n] = _probability(_log_odds(p_turned[n]) + share * math.log(odds))
        turned[i] = p_turned[n] > 0.5
        if turned[i]:
            p_turned[n] = 1.0 - p_turned[n]
    return turned

"""Tracklets of one object joined across the gap in which it was lost: one global assignment.

A tracklet b that starts after another, a, has ended either continues it or is a new object. With z
the first state of b, given all its detections, and t the gap,

    continues   pi e^(-t / tau) dt / tau  p(z | a)  p(size_b | size_a)  p(score_b | score_a)
    is new      (1 - pi) lambda p_0(velocity)  p(size_b)  p(score_b)

pi is the share of ends that are interruptions, tau the mean gap, lambda the density of new
tracklets per square metre and step: all estimated from the scene's tracklets, pi and tau with the
links themselves, in a few rounds. Sizes and scores are normal over the tracklets of the class; the
sizes of one object correlate as far as their spread is more than that of measuring them.
p(z | a) weighs two hypotheses as the tracker does: a stood, and b starts where it was left; or it
moved on at constant velocity with the class's process noise. The assignment with the largest sum of
log likelihood ratios wins; a pair that is likelier new is never joined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import logit

from mottrack.core.arrays import F64, I64
from mottrack.core.objects import Tracks
from mottrack.core.sweep import SECOND_NS
from mottrack.trackers.kalman.clutter import spanned_area_m2
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.noise import NoiseTable, pair_growth
from mottrack.trackers.kalman.state import SIZE, XY_VELOCITY
from mottrack.trackers.kalman.tracklets import Tracklet

ROUNDS = 4
"""Of estimating pi and tau with the links: two numbers, of which each link is a sample."""
PRIOR_LINKS, PRIOR_ENDS, PRIOR_GAP_S = 1.0, 5.0, 3.0
"""One interruption of 3 s among five ends, a weak prior: the tracker bridges shorter ones."""
GAPS_SEARCHED = 12.0
"""Longest gap that is searched, in mean gaps: e^-12 leaves nothing."""
FASTEST_MPS = 60.0
"""No road user is faster: pairs farther apart are not compared."""
SLACK_M = 10.0
"""Added to that reach: both ends have errors."""
CERTAIN = 1e-9
"""Nearest that a probability comes to 0 or 1, whose logarithms are taken."""
SCORE_KEPT = 0.5
"""Correlation of the mean scores of an object's tracklets: seen again, it is nearer or farther."""
MOST_ALIKE = 0.95
"""Largest correlation of sizes: no detector measures better than that."""
LEAST_VARIANCE = 1e-4
"""(1 cm)^2, or 1 % of a score: of two tracklets the spread says nothing."""


class Link(NamedTuple):
    """Tracklet `after` continues `before`; indices."""

    before: int
    after: int


def link(
    tracklets: Sequence[Tracklet], steps: Sequence[Tracks], config: KalmanConfig
) -> list[Link]:
    """Return the links between the smoothed tracklets of a scene.

    Args:
        tracklets: each with its states given all its detections.
        steps: what the tracker returned, step by step.
        config: that tracker's settings.
    """
    links: list[Link] = []
    for label in sorted({t.label for t in tracklets}):
        rows = [k for k, t in enumerate(tracklets) if t.label == label]
        ends = _Ends.of([tracklets[k] for k in rows], steps)
        found = _Linker(ends, _Class.of(label, ends, steps, config)).links()
        links += [Link(rows[a], rows[b]) for a, b in found]
    return links


@dataclass(frozen=True)
class _Ends:
    """First and last states of n tracklets."""

    first_s: F64
    """(n,) time of the first state."""
    last_s: F64
    """(n,)"""
    first: F64
    """(n, 4) x, y, d_x, d_y."""
    last: F64
    """(n, 4)"""
    first_spread: F64
    """(n, 4, 4)"""
    last_spread: F64
    """(n, 4, 4)"""
    size: F64
    """(n, 3) mean over the tracklet."""
    score: F64
    """(n,)"""

    @classmethod
    def of(cls, tracklets: Sequence[Tracklet], steps: Sequence[Tracks]) -> _Ends:
        stamp_s = np.array([step.stamp_ns - steps[0].stamp_ns for step in steps]) / SECOND_NS
        block = np.ix_(XY_VELOCITY, XY_VELOCITY)
        first, last = ([t.estimates[k] for t in tracklets] for k in (0, -1))
        return cls(
            stamp_s[[e.step for e in first]],
            stamp_s[[e.step for e in last]],
            np.array([e.mean[XY_VELOCITY] for e in first]),
            np.array([e.mean[XY_VELOCITY] for e in last]),
            np.array([e.covariance[block] for e in first]),
            np.array([e.covariance[block] for e in last]),
            np.array([np.mean([e.mean[SIZE] for e in t.estimates], axis=0) for t in tracklets]),
            np.array([t.score for t in tracklets]),
        )


@dataclass(frozen=True)
class _Class:
    """What is known of a class."""

    process: F64
    """(1, 11) process noise per second."""
    velocity_variance: float
    """Of one axis of a new object's velocity."""
    p_standing: float
    size_variance: F64
    """(3,) of an observed size about the object's."""
    density: float
    """New tracklets per square metre and step."""
    step_s: float
    wiener: bool

    @classmethod
    def of(cls, label: str, ends: _Ends, steps: Sequence[Tracks], config: KalmanConfig) -> _Class:
        table = NoiseTable(config.noise)
        noise = table.rows(table.index(np.array([label])))
        area = float(np.mean([spanned_area_m2(step.centre_m[:, :2]) for step in steps]))
        standing, count = config.standing, len(steps)
        span_s = float(steps[-1].stamp_ns - steps[0].stamp_ns) / SECOND_NS
        density = len(ends.score) / (area * count)
        return cls(
            process=noise.process,
            velocity_variance=float(noise.initial[0, 7:9].mean()),
            p_standing=standing.prior.get(label, standing.other) if standing.use else 0.0,
            size_variance=noise.observation[0, 4:7],
            density=density * config.association.clutter_concentration,
            step_s=span_s / max(count - 1, 1),
            wiener=config.noise.form == "wiener",
        )


class _Linker:
    """The tracklets of one class."""

    def __init__(self, ends: _Ends, about: _Class) -> None:
        self._ends, self._class = ends, about

    def links(self) -> list[Link]:
        share, gap_s = PRIOR_LINKS / PRIOR_ENDS, PRIOR_GAP_S
        found: list[Link] = []
        for _ in range(ROUNDS):
            found = self._assigned(share, gap_s)
            a, b = (np.array([pair[k] for pair in found], np.int64) for k in (0, 1))
            gaps = self._ends.first_s[b] - self._ends.last_s[a]
            share = (len(found) + PRIOR_LINKS) / (len(self._ends.score) + PRIOR_ENDS)
            gap_s = (gaps.sum() + PRIOR_GAP_S) / (len(gaps) + 1)
        return found

    def _assigned(self, share: float, gap_s: float) -> list[Link]:
        ends, about = self._ends, self._class
        dt = ends.first_s[None, :] - ends.last_s[:, None]
        away = np.linalg.norm(ends.first[None, :, :2] - ends.last[:, None, :2], axis=2)
        near = (dt > 0) & (dt <= GAPS_SEARCHED * gap_s) & (away < FASTEST_MPS * dt + SLACK_M)
        a, b = np.nonzero(near)
        if not len(a):
            return []
        gap = dt[a, b]
        ratio = logit(share) + np.log(about.step_s / gap_s) - gap / gap_s
        ratio += self._motion(a, b, gap) + self._size(a, b) + self._score(a, b)
        gain = np.zeros((len(ends.score), len(ends.score)))
        gain[a, b] = np.maximum(ratio, 0.0)
        rows, columns = linear_sum_assignment(gain, maximize=True)
        joined = gain[rows, columns] > 0
        pairs = zip(rows[joined].tolist(), columns[joined].tolist(), strict=True)
        return [Link(*pair) for pair in pairs]

    def _motion(self, a: I64, b: I64, gap: F64) -> F64:
        """Return ln p(z | a) - ln lambda p_0 of pairs (P,)."""
        ends, about = self._ends, self._class
        moved = np.tile(np.eye(4), (len(gap), 1, 1))
        moved[:, 0, 2] = moved[:, 1, 3] = gap
        growth = pair_growth(np.tile(about.process, (len(gap), 1)), gap, about.wiener)
        spread = moved @ ends.last_spread[a] @ moved.transpose(0, 2, 1) + ends.first_spread[b]
        for k in range(2):
            spread[:, k, k] += growth.position[:, k]
            spread[:, k + 2, k + 2] += growth.rate[:, k]
            spread[:, k, k + 2] += growth.both[:, k]
            spread[:, k + 2, k] += growth.both[:, k]
        offset = ends.first[b] - np.einsum("nij,nj->ni", moved, ends.last[a])
        moves = _log_normal(offset, spread)
        wander = (about.process[0, :2] * gap[:, None])[:, :, None] * np.eye(2)
        place = ends.last_spread[a][:, :2, :2] + ends.first_spread[b][:, :2, :2] + wander
        stood = self._log_standing(ends.last[a, 2:], ends.last_spread[a][:, 2:, 2:])
        speed, speed_spread = ends.first[b, 2:], ends.first_spread[b][:, 2:, 2:]
        stands = _log_normal(ends.first[b, :2] - ends.last[a, :2], place)
        stands += _log_normal(speed, speed_spread)
        continues = np.logaddexp(stood + stands, np.log1p(-np.exp(stood) * (1.0 - CERTAIN)) + moves)
        new = self._log_new_velocity(speed, speed_spread)
        return np.asarray(continues - np.log(about.density) - new)

    def _log_standing(self, velocity: F64, spread: F64) -> F64:
        """Return ln of the probability (P,) that objects of these velocities stand."""
        rest, moves = self._log_rest_or_moving(velocity, spread)
        return np.asarray(rest - np.logaddexp(rest, moves))

    def _log_new_velocity(self, velocity: F64, spread: F64) -> F64:
        """Return ln p_0 (P,) of the velocities of new objects."""
        return np.logaddexp(*self._log_rest_or_moving(velocity, spread))

    def _log_rest_or_moving(self, velocity: F64, spread: F64) -> tuple[F64, F64]:
        prior = min(max(self._class.p_standing, CERTAIN), 1.0 - CERTAIN)
        moving = spread + self._class.velocity_variance * np.eye(2)
        rest = np.log(prior) + _log_normal(velocity, spread)
        return rest, np.log1p(-prior) + _log_normal(velocity, moving)

    def _size(self, a: I64, b: I64) -> F64:
        size = self._ends.size
        spread = np.maximum(size.var(axis=0), LEAST_VARIANCE)
        kept = np.clip(1.0 - self._class.size_variance / spread, 0.0, MOST_ALIKE)
        return np.asarray(_alike(size[a], size[b], kept, size).sum(axis=1))

    def _score(self, a: I64, b: I64) -> F64:
        score = self._ends.score[:, None]
        kept = np.array([SCORE_KEPT])
        return np.asarray(_alike(score[a], score[b], kept, score).sum(axis=1))


def _alike(before: F64, after: F64, kept: F64, ends: F64) -> F64:
    """Return ln p(after | before) - ln p(after), (P, D), if the correlation of both is `kept` (D,).

    Both are normal with mean and variance of all `ends` (n, D).
    """
    mean, variance = ends.mean(axis=0), np.maximum(ends.var(axis=0), LEAST_VARIANCE)
    same = _log_scalar(after - mean - kept * (before - mean), variance * (1.0 - kept**2))
    return np.asarray(same - _log_scalar(after - mean, variance))


def _log_normal(x: F64, spread: F64) -> F64:
    """Return ln N(x; 0, S) of rows (P, D)."""
    squared = np.einsum("ni,ni->n", x, np.linalg.solve(spread, x[:, :, None])[:, :, 0])
    return np.asarray(
        -0.5 * (squared + np.linalg.slogdet(spread)[1] + x.shape[1] * np.log(2 * np.pi))
    )


def _log_scalar(x: F64, variance: F64) -> F64:
    return np.asarray(-0.5 * (x**2 / variance + np.log(2 * np.pi * variance)))

"""The states of each identity over a finished scene, and rows of them made tracks again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.objects import Tracks
from mottrack.trackers.kalman.moments import Moments, mixture
from mottrack.trackers.kalman.state import SIZE, SMALLEST_SIZE_M, STATE_SIZE, VELOCITY, YAW


class Estimate(NamedTuple):
    """State of a track at a step."""

    step: int
    mean: F64
    """(11,)"""
    covariance: F64
    """(11, 11)"""
    observed: bool
    score: float
    """Published at the step; 0 where nothing was."""
    p_moving: float
    """Probability that it moves: the share of the state's velocity that was published."""

    def with_size(self, size_m: F64) -> Estimate:
        """Return the same state with other sides (3,)."""
        mean = self.mean.copy()
        mean[SIZE] = size_m
        return self._replace(mean=mean)


class Tracklet(NamedTuple):
    """One identity, from its first detection to its last."""

    identity: int
    label: str
    score: float
    """Mean over its published rows."""
    estimates: list[Estimate]
    coasted: list[Estimate]
    """What was published after the last detection."""

    @property
    def hits(self) -> int:
        """Number of steps with a detection."""
        return sum(estimate.observed for estimate in self.estimates)


def tracklets_of(steps: Sequence[Tracks]) -> list[Tracklet]:
    """Return the tracklets of a scene, in the order in which they were first published."""
    found: dict[int, list[Estimate]] = {}
    label: dict[int, str] = {}
    for k, step in enumerate(steps):
        share = _share_moving(step)
        for row, identity in enumerate(step.id.tolist()):
            label.setdefault(identity, str(step.label[row]))
            state, covariance = step.state[row], step.covariance[row]
            seen, score = bool(step.observed[row]), float(step.score[row])
            estimate = Estimate(k, state, covariance, seen, score, float(share[row]))
            found.setdefault(identity, []).append(estimate)
    return [_tracklet(identity, label[identity], found[identity]) for identity in found]


def _tracklet(identity: int, label: str, estimates: list[Estimate]) -> Tracklet:
    last = max((k for k, e in enumerate(estimates) if e.observed), default=0)
    body, coasted = estimates[: last + 1], estimates[last + 1 :]
    return Tracklet(identity, label, float(np.mean([e.score for e in body])), body, coasted)


def _share_moving(step: Tracks) -> F64:
    """Return the published velocity over the state's, (N,)."""
    velocity = step.state[:, VELOCITY]
    square = np.sum(velocity**2, axis=1)
    along = np.sum(velocity * step.velocity_mps, axis=1)
    share = np.divide(along, square, out=np.ones(len(step)), where=square > 0)
    return np.asarray(np.clip(share, 0.0, 1.0))


def collected(steps: Sequence[Tracks], tracklets: Sequence[Tracklet]) -> list[Tracks]:
    """Return the tracks of every step of a scene, each state that of a tracklet at that step."""
    rows: list[list[_Row]] = [[] for _ in steps]
    for tracklet in tracklets:
        for estimate in tracklet.estimates:
            rows[estimate.step].append(_Row(tracklet, estimate))
    return [_collect(step, found) for step, found in zip(steps, rows, strict=True)]


class _Row(NamedTuple):
    """An estimate at one step, and the tracklet that it belongs to."""

    track: Tracklet
    estimate: Estimate


def _collect(step: Tracks, rows: list[_Row]) -> Tracks:
    if not rows:
        return Tracks.empty(step.stamp_ns, step.frame, STATE_SIZE)
    state = np.array([estimate.mean for _, estimate in rows])
    covariance = np.array([estimate.covariance for _, estimate in rows])
    moving = Moments(state[:, VELOCITY], covariance[:, VELOCITY, VELOCITY])
    at_rest = Moments(np.zeros((len(rows), 2)), np.zeros((len(rows), 2, 2)))
    velocity = mixture(at_rest, moving, np.array([estimate.p_moving for _, estimate in rows]))
    return Tracks(
        stamp_ns=step.stamp_ns,
        frame=step.frame,
        centre_m=state[:, :3],
        size_m=np.maximum(state[:, SIZE], SMALLEST_SIZE_M),
        yaw_rad=state[:, YAW],
        label=np.array([track.label for track, _ in rows]),
        id=np.array([track.identity for track, _ in rows]),
        score=np.array([track.score for track, _ in rows]),
        velocity_mps=velocity.mean,
        velocity_covariance_m2ps2=velocity.covariance,
        state=state,
        covariance=covariance,
        observed=np.array([estimate.observed for _, estimate in rows]),
    )

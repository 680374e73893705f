"""Labels from a finished scene: tracks smoothed, rid of ghosts, linked across gaps, of one size.

Each track is smoothed (`smoothing`), tracks that are more likely false are dropped (`ghosts`), and
tracklets of one object are joined (`linking`), the gap between them filled from both sides.
After its last detection a track goes on as long as its object is more likely there than gone, with
the share of misses that the scene's own tracks have. The score of a track, the same at every step,
is the mean of its detections' times h / (h + prior_misses), h being their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.objects import Tracks
from mottrack.core.pose import wrap_angle
from mottrack.geometry.angles import heading_residual
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.ghosts import p_real
from mottrack.trackers.kalman.linking import Link, link
from mottrack.trackers.kalman.smoothing import Motion, Motions
from mottrack.trackers.kalman.state import SIZE, YAW
from mottrack.trackers.kalman.track_management import TrackManagementConfig
from mottrack.trackers.kalman.tracklets import Estimate, Tracklet, collected, tracklets_of


def labels(steps: Sequence[Tracks], config: KalmanConfig) -> list[Tracks]:
    """Return the tracks of a finished scene as labels; `config.offline` chooses the parts.

    Args:
        steps: outputs of `KalmanTracker.step`, in order.
        config: that tracker's settings.

    Raises:
        ConfigError: the tracker counts in frames, whose length the smoother does not know.
    """
    motions, chosen = Motions(steps, config), config.offline
    tracklets = [motions.of(t.label).smoothed(t) for t in tracklets_of(steps)]
    if chosen.remove_ghosts:  # before links are sought, which would chain ghosts to long tracks
        tracklets = _without_ghosts(tracklets)
    missed = miss_shares(tracklets)
    links = link(tracklets, steps, config) if chosen.link else []
    tracks = [_joined(parts, motions) for parts in _chains(tracklets, links)]
    rules = config.track_management
    tracks = [_ended(t, missed[t.label], rules) for t in tracks]
    if chosen.vote_sizes:
        tracks = [_of_one_size(track) for track in tracks]
    return collected(steps, tracks)


def miss_shares(tracklets: Sequence[Tracklet]) -> dict[str, float]:
    """Return the share of steps without a detection between a tracklet's first and last, by class.

    It is the mean of a Beta law with one miss and one detection before any was counted.
    """
    counts: dict[str, F64] = {}
    for tracklet in tracklets:
        steps = tracklet.estimates[-1].step - tracklet.estimates[0].step + 1
        count = counts.setdefault(tracklet.label, np.array([1.0, 2.0]))
        count += steps - tracklet.hits, steps
    return {label: float(missed / steps) for label, (missed, steps) in counts.items()}


def _chains(tracklets: Sequence[Tracklet], links: Sequence[Link]) -> list[list[Tracklet]]:
    """Return the tracklets of each object, in order of time."""
    following = {pair.before: pair.after for pair in links}
    chains = []
    for first in sorted(set(range(len(tracklets))) - set(following.values())):
        chain = [first]
        while chain[-1] in following:
            chain.append(following[chain[-1]])
        chains.append([tracklets[k] for k in chain])
    return chains


def _joined(parts: Sequence[Tracklet], motions: Motions) -> Tracklet:
    """Return one tracklet of several, with every step of the gaps between them."""
    motion, estimates = motions.of(parts[0].label), list(parts[0].estimates)
    for before, after in pairwise(parts):
        estimates += _bridge(motion, before.estimates[-1], after.estimates[0])
        estimates += after.estimates
    return parts[0]._replace(estimates=estimates, coasted=parts[-1].coasted)


def _bridge(motion: Motion, before: Estimate, after: Estimate) -> list[Estimate]:
    """Return the states between two, each predicted from both sides and fused."""
    bridge = []
    for step in range(before.step + 1, after.step):
        ahead, back = motion.predicted(before, step)[0], motion.predicted(after, step)[0]
        gain = np.linalg.solve(ahead.covariance + back.covariance, ahead.covariance).T
        offset = back.mean - ahead.mean
        offset[YAW] = heading_residual(offset[YAW])
        mean = ahead.mean + gain @ offset
        mean[YAW] = wrap_angle(mean[YAW])
        spread = ahead.covariance - gain @ ahead.covariance
        moving = 0.5 * (ahead.p_moving + back.p_moving)
        symmetric = 0.5 * (spread + spread.T)
        bridge.append(ahead._replace(mean=mean, covariance=symmetric, p_moving=moving))
    return bridge


def _ended(track: Tracklet, missed: float, rules: TrackManagementConfig) -> Tracklet:
    """Return a track with what it coasted while its object was likely there, and its score."""
    odds, kept = rules.p_present / (1.0 - rules.p_present), []
    for estimate in track.coasted:
        odds *= missed
        if odds <= 1.0:
            break
        kept.append(estimate)
    scores = [e.score for e in track.estimates if e.observed]
    trust = track.hits / (track.hits + rules.prior_misses)
    # a score may be below zero: trust lowers it all the same
    mean = float(np.mean(scores)) if scores else track.score
    score = mean - (1.0 - trust) * abs(mean)
    return track._replace(estimates=[*track.estimates, *kept], coasted=[], score=score)


def _without_ghosts(tracks: Sequence[Tracklet]) -> list[Tracklet]:
    kept = np.ones(len(tracks), np.bool_)
    label = np.array([t.label for t in tracks])
    for name in np.unique(label):
        mine = label == name
        own = [track for track, chosen in zip(tracks, mine, strict=True) if chosen]
        hits = np.array([max(track.hits, 1) for track in own], np.int64)
        score = np.array([track.score for track in own])
        kept[mine] = p_real(hits, score) >= 0.5
    return [track for track, real in zip(tracks, kept, strict=True) if real]


def _of_one_size(track: Tracklet) -> Tracklet:
    """Return a track whose box has the median of its sides, weighted by score."""
    seen = [e for e in track.estimates if e.observed] or track.estimates
    size = np.array([e.mean[SIZE] for e in seen])
    # scores may be below zero: weights are counted from the lowest, which still counts a little
    score = np.array([e.score for e in seen])
    weight = score - score.min() + np.ptp(score) / len(score) + np.finfo(np.float64).tiny
    voted = np.array([weighted_median(column, weight) for column in size.T])
    return track._replace(estimates=[e.with_size(voted) for e in track.estimates])


def weighted_median(values: F64, weight: F64) -> float:
    """Return the value (of n) at which half of the weight (n,) is reached."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])

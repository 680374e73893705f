"""Confirmation, output, scoring and deletion of tracks."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator
from typing_extensions import override

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.sweep import SECOND_NS, seconds_between
from mottrack.trackers.kalman.track_rows import TrackRows

ROUNDING = 1e-6
"""Added to a quotient of times: 0.3 s are three steps of 0.1 s, whatever the quotient rounds to."""


COUNTERS = {
    "min_hits",
    "confirm_s",
    "output_misses",
    "output_coast_s",
    "coast_at_most_age",
    "undetected_classes",
    "score",
    "decay_per_s",
}
EXISTENCE = {
    "p_detection",
    "p_present",
    "mean_life_s",
    "min_presence",
    "misses_per_hit",
    "prior_misses",
    "independent_s",
}
"""Settings that one rule alone reads."""


class TrackManagementConfig(StrictModel):
    """Initiation, output and deletion. A track lives while either of its two limits allows it."""

    rule: Literal["counters", "existence"] = Field(
        "counters",
        description="counters: hits and misses; existence: probability that the object is there",
    )
    birth_score: float | None = Field(None, description="weaker detections start no track")
    min_hits: int = Field(1, ge=1, description="detections that confirm a track for output")
    confirm_s: float = Field(
        0.0, ge=0, description="and at least as many as fit in this time, the first not counted"
    )
    max_misses: int = Field(1, ge=0, description="steps without a detection a track survives")
    max_coast_s: float = Field(0.0, ge=0, description="seconds without one a track survives")
    output_misses: int = Field(1, ge=0, description="steps without one a track is still published")
    output_coast_s: float = Field(0.0, ge=0, description="seconds without one it is published")
    coast_at_most_age: bool = Field(
        False, description="coast no longer in seconds than the track was detected before"
    )
    undetected_classes: Literal["age", "freeze"] = Field(
        "age", description="freeze: skip tracks of a class without detections in this step"
    )
    score: Literal["last", "mean", "confidence"] = Field(
        "last",
        description="published score: last detection, mean, or probability from all detections",
    )
    decay_per_s: float = Field(
        1.0, gt=0, le=1, description="factor on the score per second of coasting"
    )
    p_detection: float = Field(
        0.97, gt=0, lt=1, description="existence: probability that a present object is detected"
    )
    p_present: float = Field(
        0.95, gt=0, lt=1, description="existence: that a detected object is there at the next step"
    )
    mean_life_s: float = Field(
        20.0, gt=0, description="existence: mean time that an object stays within sight"
    )
    min_presence: float = Field(
        0.01, ge=0, lt=1, description="existence: tracks below it are kept, but not published"
    )
    misses_per_hit: float = Field(
        0.25, ge=0, description="existence: misses beyond max_misses, per detection of the track"
    )
    prior_misses: float = Field(
        1.0, ge=0, description="existence: the score counts h hits as h / (h + prior_misses)"
    )
    independent_s: float = Field(
        0.2,
        ge=0,
        description="existence: a detection so long after the last one counts as one hit in the "
        "score, a step of a part of it as that part: false alarms repeat, too",
    )

    @model_validator(mode="after")
    def _check_rule(self) -> Self:
        """Refuse settings of the rule that is not chosen: they would do nothing."""
        other = COUNTERS if self.rule == "existence" else EXISTENCE
        fields = type(self).model_fields
        for name in sorted(other):
            if getattr(self, name) != fields[name].default:
                rule = "counters" if self.rule == "existence" else "existence"
                raise ValueError(f"{name} needs rule: {rule}, the rule is {self.rule}")
        return self


class TrackManagement:
    """The rules of output and deletion over `TrackRows`, and the count of steps by class."""

    def __init__(self, config: TrackManagementConfig) -> None:
        self._config = config
        self._freezes = config.undetected_classes == "freeze"
        self._steps = np.zeros(0, np.int64)
        self._min_hits = config.min_hits
        self._elapsed_s = 1.0

    def active(self, label: I64, present: I64) -> Mask:
        """Return which tracks take part in a step with detections of the classes `present`."""
        return np.isin(label, present) if self._freezes else np.ones(len(label), bool)

    def begin(self, tracks: TrackRows, present: I64, classes: int, elapsed_s: float) -> None:
        """Begin a step: count a miss for every active track, until a detection resets it."""
        config = self._config
        self._min_hits = max(config.min_hits, 1 + int(config.confirm_s / elapsed_s + ROUNDING))
        tracks.misses += self.active(tracks.label, present)
        tracks.source[:] = -1
        self._steps = np.concatenate([self._steps, np.zeros(classes - len(self._steps), np.int64)])
        if self._freezes:
            self._steps[np.unique(present)] += 1
        else:
            self._steps += 1

    def is_published(self, tracks: TrackRows, present: I64, stamp_ns: int) -> Mask:
        """Return which tracks are published: confirmed or in the first steps, not coasting long.

        A confirmed track stays confirmed: after two steps in quick succession, `confirm_s` asks
        for more detections than any track has, which must not hide them all.
        """
        config = self._config
        tracks.confirmed |= tracks.hits >= self._min_hits
        confirmed = tracks.confirmed | (self._steps[tracks.label] <= self._min_hits)
        recent = tracks.misses <= config.output_misses
        recent |= self._within(tracks, stamp_ns, config.output_coast_s)
        return confirmed & recent & self.active(tracks.label, present)

    def alive(self, tracks: TrackRows, stamp_ns: int) -> Mask:
        """Return which tracks live on into the next step."""
        by_steps = tracks.misses <= self._config.max_misses
        return by_steps | self._within(tracks, stamp_ns, self._config.max_coast_s)

    def _within(self, tracks: TrackRows, stamp_ns: int, limit_s: float) -> Mask:
        """Return which tracks were last detected at most `limit_s` ago, compared in integer ns."""
        coasted_ns = stamp_ns - tracks.seen_ns
        allowed = coasted_ns <= round(limit_s * SECOND_NS)
        if self._config.coast_at_most_age:
            allowed &= coasted_ns <= tracks.seen_ns - tracks.born_ns
        return allowed

    def score(self, tracks: TrackRows, stamp_ns: int) -> F64:
        """Return the score of every track, less the decay of coasting."""
        kinds = {
            "last": tracks.score,
            "mean": tracks.score_sum / tracks.hits,
            "confidence": tracks.confidence,
        }
        score = kinds[self._config.score]
        coasted_s = seconds_between(tracks.seen_ns, stamp_ns)
        loss = 1.0 - self._config.decay_per_s**coasted_s
        return np.asarray(score - loss * np.abs(score))


def record_hits(tracks: TrackRows, rows: I64, score: F64, source: I64, stamp_ns: int) -> None:
    """Record the detections of the matched tracks `rows` (n,).

    Confidence is 1 - (1 - c)(1 - s): the probability that not all detections so far were false, for
    scores that are independent probabilities.
    """
    tracks.hits[rows] += 1
    tracks.misses[rows] = 0
    tracks.score[rows] = score
    tracks.score_sum[rows] += score
    likely = np.minimum(np.maximum(score, 0.0), 1.0)  # `clip` takes three times as long
    tracks.confidence[rows] = 1.0 - (1.0 - tracks.confidence[rows]) * (1.0 - likely)
    tracks.seen_ns[rows] = stamp_ns
    tracks.source[rows] = source


class ExistenceManagement(TrackManagement):
    """Management by the probability that a track's object is there: a Bernoulli track.

    A detection makes the presence r the setting `p_present`. Over a step of dt seconds without one,

        r <- r exp(-dt / mean_life_s),    r / (1 - r) <- (1 - p_detection) r / (1 - r),

    as in the Bernoulli filter (Vo, Vo, Mahler, 2013). The published score is the last detection's
    times r times h / (h + prior_misses), h being the number of detections: the posterior mean of a
    track's detection rate, so that tracks of one detection rank below longer ones, and coasted
    boxes below detected ones. A track is kept, unpublished, for `max_misses` steps and
    `misses_per_hit` more for each of its detections, `max_coast_s` at most: a detection where the
    object is expected then takes it up again under the same id.
    """

    @override
    def begin(self, tracks: TrackRows, present: I64, classes: int, elapsed_s: float) -> None:
        """Begin a step: every track is missed, until a detection makes it present."""
        config = self._config
        self._elapsed_s = elapsed_s
        tracks.misses += 1
        tracks.source[:] = -1
        presence = tracks.presence * np.exp(-elapsed_s / config.mean_life_s)
        missed = presence * (1.0 - config.p_detection)
        tracks.presence[:] = missed / (missed + 1.0 - presence)

    @override
    def is_published(self, tracks: TrackRows, present: I64, stamp_ns: int) -> Mask:
        """Return which tracks are published: their objects are probable enough to be there."""
        tracks.presence[tracks.misses == 0] = self._config.p_present
        return tracks.presence >= self._config.min_presence

    @override
    def alive(self, tracks: TrackRows, stamp_ns: int) -> Mask:
        """Return which tracks live on into the next step."""
        allowed = self._config.max_misses + self._config.misses_per_hit * tracks.hits
        return (tracks.misses <= allowed) & self._within(tracks, stamp_ns, self._config.max_coast_s)

    @override
    def score(self, tracks: TrackRows, stamp_ns: int) -> F64:
        """Return the score of every track, by presence and number of detections."""
        config = self._config
        prior = config.prior_misses * max(1.0, config.independent_s / self._elapsed_s)
        trust = tracks.presence * tracks.hits / (tracks.hits + prior)
        return tracks.score - (1.0 - trust) * np.abs(tracks.score)


def make_management(config: TrackManagementConfig) -> TrackManagement:
    """Return the rules that `config.rule` names."""
    return ExistenceManagement(config) if config.rule == "existence" else TrackManagement(config)

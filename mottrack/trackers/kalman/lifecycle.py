"""When a track is put out, what its score is, and when it dies."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.kalman.track_rows import TrackRows

ROUNDING = 1e-6
"""Three tenths of a second are three steps of a tenth, whatever the quotient rounds to."""


class TrackManagementConfig(StrictModel):
    """Birth, output and death. A track lives while either of its two limits allows it."""

    birth_score: float | None = Field(None, description="weaker detections start no track")
    min_hits: int = Field(1, ge=1, description="detections before a track is put out")
    confirm_s: float = Field(
        0.0, ge=0, description="and at least so many as come in this time, the first not counted"
    )
    max_misses: int = Field(1, ge=0, description="steps without a detection a track survives")
    max_coast_s: float = Field(0.0, ge=0, description="seconds without one a track survives")
    output_misses: int = Field(1, ge=0, description="steps without one a track is still put out")
    output_coast_s: float = Field(0.0, ge=0, description="seconds without one it is put out")
    earn_coasting: bool = Field(
        False, description="coast no longer in seconds than the track has been seen before"
    )
    silent_classes: Literal["age", "freeze"] = Field(
        "age", description="freeze: tracks of a class without detections stand still, unseen"
    )
    score: Literal["last", "mean", "confidence"] = Field(
        "last",
        description="score put out: of the last detection, their mean, or belief in the track",
    )
    decay_per_s: float = Field(
        1.0,
        gt=0,
        le=1,
        description="share of its size that the score keeps in a second of coasting",
    )


class TrackManagement:
    """The rules of output and death over a `TrackRows`, and the count of steps by class."""

    def __init__(self, config: TrackManagementConfig) -> None:
        self._config = config
        self._freezes = config.silent_classes == "freeze"
        self._steps = np.zeros(0, np.int64)
        self._min_hits = config.min_hits

    def active(self, label: I64, present: I64) -> Mask:
        """Which tracks take part in a step with detections of the classes `present`."""
        return np.isin(label, present) if self._freezes else np.ones(len(label), bool)

    def begin(self, book: TrackRows, present: I64, classes: int, elapsed_s: float) -> None:
        """Begins a step: every active track is missed until a detection says otherwise."""
        config = self._config
        self._min_hits = max(config.min_hits, 1 + int(config.confirm_s / elapsed_s + ROUNDING))
        book.misses += self.active(book.label, present)
        book.source[:] = -1
        self._steps = np.concatenate([self._steps, np.zeros(classes - len(self._steps), np.int64)])
        if self._freezes:
            self._steps[np.unique(present)] += 1
        else:
            self._steps += 1

    def shown(self, book: TrackRows, present: I64, stamp_ns: int) -> Mask:
        """Tracks that are put out: confirmed, or in the first steps, and not missed for long.

        Once confirmed stays confirmed: two steps that come close together ask for more detections
        than any track has, and must not hide them all.
        """
        config = self._config
        book.confirmed |= book.hits >= self._min_hits
        grown = book.confirmed | (self._steps[book.label] <= self._min_hits)
        fresh = book.misses <= config.output_misses
        fresh |= self._within(book, stamp_ns, config.output_coast_s)
        return grown & fresh & self.active(book.label, present)

    def alive(self, book: TrackRows, stamp_ns: int) -> Mask:
        """Tracks that live on into the next step."""
        by_steps = book.misses <= self._config.max_misses
        return by_steps | self._within(book, stamp_ns, self._config.max_coast_s)

    def _within(self, book: TrackRows, stamp_ns: int, limit_s: float) -> Mask:
        """Tracks last detected at most `limit_s` ago; in nanoseconds, so no rounding decides."""
        coasted_ns = stamp_ns - book.seen_ns
        allowed = coasted_ns <= round(limit_s * 1e9)
        if self._config.earn_coasting:
            allowed &= coasted_ns <= book.seen_ns - book.born_ns
        return np.asarray(allowed)

    def score(self, book: TrackRows, stamp_ns: int) -> F64:
        """Score of every track, less the decay of coasting."""
        kinds = {
            "last": book.score,
            "mean": book.score_sum / book.hits,
            "confidence": book.confidence,
        }
        score = kinds[self._config.score]
        loss = 1.0 - self._config.decay_per_s ** coasted_s(book, stamp_ns)
        return np.asarray(score - loss * np.abs(score))


def coasted_s(book: TrackRows, stamp_ns: int) -> F64:
    """Seconds since each track was last detected."""
    return np.asarray((stamp_ns - book.seen_ns) * 1e-9, np.float64)


def record_hits(book: TrackRows, rows: I64, score: F64, source: I64, stamp_ns: int) -> None:
    """Books the detections of matched tracks.

    Confidence is 1 - (1 - c)(1 - s) for scores that are probabilities: every detection is a
    further reason to believe in the object.
    """
    book.hits[rows] += 1
    book.misses[rows] = 0
    book.score[rows] = score
    book.score_sum[rows] += score
    likely = np.clip(score, 0.0, 1.0)
    book.confidence[rows] = 1.0 - (1.0 - book.confidence[rows]) * (1.0 - likely)
    book.seen_ns[rows] = stamp_ns
    book.source[rows] = source

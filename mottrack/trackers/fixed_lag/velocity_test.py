"""The test of the source of measured velocities, from the displacement of tracks over the window.

What `velocity_source.SourceTest` compares velocities with is the straight line through a track's
positions (`missed_motion`), which no velocity has changed. A track stands with the probability
that `p_static` and the displacement give it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.concerns import Concern
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.engine import Engine
from mottrack.trackers.fixed_lag.missed_motion import MissedMotionTest, Motion
from mottrack.trackers.fixed_lag.nodes import Measurements
from mottrack.trackers.velocity_source.evidence import judge_all
from mottrack.trackers.velocity_source.law import Law
from mottrack.trackers.velocity_source.source_test import SourceTest


class Judged(NamedTuple):
    """Tracks (n) that were seen in a step, and the objects that they were seen as."""

    slots: I64
    rows: I64
    measurements: Measurements
    """Of all objects, with covariances as stated."""


class NoTest:
    """Believes every source."""

    def law(self, model: VelocityErrorModel) -> Law:
        """Return how the velocities of this step err."""
        return Law.stated(model, 1.0)

    def p_standing(self, slots: I64) -> F64:
        """Return the probability (n,) that each track stands."""
        return np.zeros(len(slots))

    def learn(self, seen: Judged, law: Law, elapsed_s: float) -> None:
        """Learn from velocities of this step, after the tracks took up its positions."""

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        return None


class VelocityTest(NoTest):
    """Estimates how a source errs."""

    def __init__(self, config: FixedLagConfig, engine: Engine) -> None:
        self._engine = engine
        self._span = config.robust.span + 1
        self._displacement = MissedMotionTest(config.missed_motion)
        self._source = SourceTest(config.velocity_test)

    def law(self, model: VelocityErrorModel) -> Law:
        """Return how the velocities of this step err.

        A line through the window lags where traffic speeds up, so it tells nothing of a gain.
        """
        if not self._source.count:
            return Law.stated(model, 1.0)
        return self._source.law(model, 1.0)._replace(gain=1.0)

    def p_standing(self, slots: I64) -> F64:
        """Return the probability (n,) that each track stands."""
        return self._motion(slots).p_standing

    def learn(self, seen: Judged, law: Law, elapsed_s: float) -> None:
        """Learn from velocities of this step, after the tracks took up its positions."""
        has = seen.measurements.has_velocity[seen.rows]
        rows, motion = seen.rows[has], self._motion(seen.slots[has])
        velocity = seen.measurements.velocity_mps[rows]
        covariance = law.scale * seen.measurements.velocity_covariance_m2ps2[rows]
        numbers = self._source.numbers(law)
        self._source.count += len(rows)
        evidence = self._source.evidence
        tracks = motion.velocity_mps, motion.covariance_m2ps2, motion.p_standing
        judge_all(evidence, (velocity, covariance), tracks, numbers, elapsed_s)

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        return self._source.concern()

    def _motion(self, slots: I64) -> Motion:
        recent = self._engine.recent(slots, self._span)
        return self._displacement.motion(self._engine.history(recent))


def make_test(config: FixedLagConfig, engine: Engine) -> NoTest:
    """Return the test that a configuration asks for; `engine` holds the tracks."""
    used = config.measurement.use_velocity and config.velocity_test.use
    return VelocityTest(config, engine) if used else NoTest()

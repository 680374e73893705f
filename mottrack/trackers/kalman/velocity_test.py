"""The test of the source of measured velocities, from the positions of the Kalman tracks.

`PositionsAlone` keeps up a state N(d, P) of every track, and the probability that it stands, from
positions only. Against these `velocity_source.SourceTest` estimates how the source errs.
"""

from __future__ import annotations

from mottrack.core.arrays import Mask
from mottrack.core.concerns import Concern
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.observations import Matched
from mottrack.trackers.kalman.positions_alone import Judged, Moved, PositionsAlone, Tracked
from mottrack.trackers.velocity_source.law import Law
from mottrack.trackers.velocity_source.source_test import SourceTest


class NoTest:
    """Believes every source: the presets that were published, and trackers without velocities."""

    def law(self, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return how the velocities of this step err."""
        return Law.stated(model, unit_s)

    def start(self, tracks: Tracked) -> None:
        """Begin at the first measured velocity, with all tracks."""

    def step(self, moved: Moved, matched: Matched, seen: Detections, law: Law) -> None:
        """Advance all tracks, correct them by positions, and learn from velocities under `law`."""

    def append(self, tracks: Tracked) -> None:
        """Add new tracks, none of whose numbers come from a velocity."""

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        return None


class VelocityTest(NoTest):
    """Estimates how a source errs; see the module."""

    def __init__(self, config: KalmanConfig) -> None:
        self._alone = PositionsAlone(config)
        self._source = SourceTest(config.velocity.test)
        self._started = False

    def law(self, model: VelocityErrorModel, unit_s: float) -> Law:
        """Return how the velocities of this step err."""
        return self._source.law(model, unit_s) if self._started else Law.stated(model, unit_s)

    def start(self, tracks: Tracked) -> None:
        """Begin at the first measured velocity, with all tracks."""
        if not self._started:
            self._started = True
            self._alone.append(tracks)

    def step(self, moved: Moved, matched: Matched, seen: Detections, law: Law) -> None:
        """Advance all tracks, correct them by positions, and learn from velocities under `law`."""
        if not self._started:
            return
        source = self._source
        judged = Judged(source.evidence, source.numbers(law))
        source.count += self._alone.step(moved, matched, seen, judged)

    def append(self, tracks: Tracked) -> None:
        """Add new tracks, none of whose numbers come from a velocity."""
        if self._started:
            self._alone.append(tracks)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        if self._started:
            self._alone.keep(mask)

    def concern(self) -> Concern | None:
        """Return a warning if the velocities of the source were given little weight."""
        return self._source.concern()


def make_test(config: KalmanConfig) -> NoTest:
    """Return the test that a configuration asks for."""
    velocity = config.velocity
    return VelocityTest(config) if velocity.use and velocity.test.use else NoTest()

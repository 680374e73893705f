"""The Kalman tracker: predict, associate, update, initiate, publish, delete."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.concerns import Concern
from mottrack.core.objects import Objects, Tracks
from mottrack.core.pose import wrap_angle
from mottrack.core.sweep import seconds_between
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.trackers.kalman.association import Innovations, Predicted, associate, innovations
from mottrack.trackers.kalman.bank import make_bank
from mottrack.trackers.kalman.block_bank import planar_covariance
from mottrack.trackers.kalman.clutter import MIN_AREA_M2, ClutterDensity, spanned_area_m2
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.detections import (
    Detections,
    error_model_of,
    observations_of,
)
from mottrack.trackers.kalman.heading import DetectedHeadings, Headings, Motion, TrackHeadings
from mottrack.trackers.kalman.noise import NoiseTable, initial_velocity_covariance
from mottrack.trackers.kalman.observations import Matched, Observation
from mottrack.trackers.kalman.positions_alone import Moved, Tracked
from mottrack.trackers.kalman.score_evidence import ScoreEvidence
from mottrack.trackers.kalman.standing import Hypotheses, Standing
from mottrack.trackers.kalman.state import SIZE, SMALLEST_SIZE_M, VELOCITY, YAW
from mottrack.trackers.kalman.track_management import make_management, record_hits
from mottrack.trackers.kalman.track_rows import LastHulls, TrackRows, new_tracks
from mottrack.trackers.kalman.velocity_test import make_test
from mottrack.trackers.step_input import checked_stamp, is_gap
from mottrack.trackers.velocity_source.law import Law


class KalmanTracker:
    """Tracks boxes of all classes in one batch (Chiu et al., 2020; PillarFlow, section IV-D).

    Make a new tracker for each scene. Input and output are in the world frame, in seconds and
    metres per second; the published presets count in frames inside and convert.
    """

    Config = KalmanConfig

    def __init__(self, config: KalmanConfig | None = None) -> None:
        self.config = config or KalmanConfig()
        self._table = NoiseTable(self.config.noise)
        self._bank = make_bank(self.config)
        self._tracks = TrackRows.empty()
        self._standing = Standing(self.config.standing)
        self._headings = Headings(self.config.heading)
        self.law = Law.stated(NO_OUTLIERS, 1.0)
        """How the velocities of the last step err, as it was known before it."""
        self._test = make_test(self.config)
        self._management = make_management(self.config.track_management)
        self._clutter = ClutterDensity(self.config.association)
        self._evidence = ScoreEvidence(self.config.association)
        self._hulls = LastHulls()
        self._next_id = 1
        self._stamp_ns: int | None = None
        self.innovations: Innovations | None = None
        """Of the last step, with `diagnose`."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advance to `stamp_ns` with this step's objects (world frame) and return the tracks.

        Raises:
            InputError: the stamp is not later than the last one, or the objects are of another
                stamp or not in the world frame; the tracker is then as it was.
        """
        stamp_ns = checked_stamp(self._stamp_ns, stamp_ns, objects)
        if is_gap(self._stamp_ns, stamp_ns):
            self._keep(np.zeros(len(self._bank), np.bool_))
        elapsed_s = self._elapsed_s(stamp_ns)
        unit_s = elapsed_s if self.config.time == "frames" else 1.0
        if objects.velocity is not None:
            self._test.start(Tracked(*self._bank.filters, self._standing.rows))
        self.law = self._test.law(error_model_of(objects, self.config), unit_s)
        seen = observations_of(objects, self.config, self._table, self.law)
        area_m2 = spanned_area_m2(seen.box[:, :2])
        gates = self._clutter.nll_gate(self._table.labels, area_m2)
        seen.nll_gate[:] = gates[seen.label]
        log_odds = self._evidence.log_odds(seen.score)
        seen.evidence[:] = self._evidence.weight(len(gates))[seen.label] * log_odds
        first, self._stamp_ns = self._stamp_ns is None, stamp_ns
        tracks, management = self._tracks, self._management
        active = management.active(tracks.label, seen.label)
        process = self._table.process(tracks.label)
        elapsed = np.where(active, elapsed_s, 0.0)
        self._bank.predict(elapsed / unit_s, process)
        self._standing.predict(self._bank.filters, elapsed, unit_s)
        management.begin(tracks, seen.label, len(self._table.labels), elapsed_s)
        matched = self._associate(seen, np.flatnonzero(active))
        self._test.step(Moved(elapsed, process, unit_s), matched, seen, self.law)
        self._update(matched, seen, elapsed_s)
        rows, columns = matched
        if self.config.yaw == "estimated":
            self._turn_by_motion(rows, elapsed_s)
        record_hits(tracks, rows, seen.score[columns], seen.source[columns], stamp_ns)
        left = np.ones(len(seen), np.bool_)
        left[columns] = False
        unmatched = np.flatnonzero(left)
        if not first:  # in a first frame every object is new
            self._clutter.record(seen.label[unmatched], len(gates), area_m2)
            self._evidence.record(seen.label, log_odds, left, len(gates))
        self._initiate(unmatched, seen, stamp_ns)
        is_published = management.is_published(tracks, seen.label, stamp_ns)
        published = self._published(np.flatnonzero(is_published), stamp_ns, unit_s)
        published = self._hulls.add_to(published, tracks, objects)
        alive = management.alive(tracks, stamp_ns)
        if not alive.all():
            self._keep(alive)
        return published

    def finish(self, steps: list[Tracks]) -> list[Tracks]:
        """Return the tracks of a finished scene as `smooth` and `offline` ask; else unchanged."""
        # only for those who ask: they import this package's parts
        if self.config.offline.enabled:
            from mottrack.trackers.kalman.offline import labels

            return labels(steps, self.config)
        if self.config.smooth:
            from mottrack.trackers.kalman.smoothing import smooth

            return smooth(steps, self.config)
        return steps

    def velocity_concern(self) -> Concern | None:
        """Return a warning if the measured velocities were given little weight so far."""
        return self._test.concern()

    @property
    def nis(self) -> F64:
        """Normalised squared innovations of the last step's boxes, 7 numbers each (`diagnose`)."""
        return np.empty(0) if self.innovations is None else self.innovations.box

    def clutter_per_m2(self) -> dict[str, float]:
        """Return the density of detections that no track explains, by class, as estimated so far.

        Empty where the association does not use it.
        """
        labels = self._table.labels
        density = self._clutter.average_per_m2(labels, MIN_AREA_M2)
        return {} if density is None else dict(zip(labels, density.tolist(), strict=True))

    def _elapsed_s(self, stamp_ns: int) -> float:
        if self._stamp_ns is None:
            return self.config.frame_s if self.config.time == "frames" else 1.0
        return seconds_between(self._stamp_ns, stamp_ns)

    def _keep(self, alive: Mask) -> None:
        self._bank.keep(alive)
        self._standing.keep(alive)
        self._headings.keep(alive)
        self._test.keep(alive)
        self._tracks.keep(alive)

    def _associate(self, seen: Detections, active: I64) -> Matched:
        bank = self._bank
        variance, label = bank.z_yaw_size_variance, self._tracks.label
        standing = self._standing.rows
        tracks = Predicted(*bank.filters, variance, label, *standing, self.law.failures)
        if len(active) < len(bank):
            tracks = tracks.select(active)
        rows, columns = associate(seen, tracks, self.config, self._table.labels)
        if self.config.diagnose:
            self.innovations = innovations(seen, tracks, (columns, rows))
        return Matched(active[rows], columns)

    def _update(self, matched: Matched, seen: Detections, elapsed_s: float) -> None:
        """Apply the Kalman updates of matched tracks by the box, then by measured velocities."""
        boxes, position = seen.boxes, Observation(seen.box, seen.xy_covariance)
        self._standing.observe_position(matched, position, self._bank.filters)
        self._weigh_headings(matched, seen, elapsed_s)
        self._bank.update_box(matched, boxes)
        measured = seen.has_velocity[matched.columns]
        if measured.any():
            rows, columns = matched.select(measured)
            self._update_velocity(rows, _velocities(seen, columns))

    def _update_velocity(self, rows: I64, velocity: Observation) -> None:
        """Update `rows` (n,) by their velocities, each as far as it is correct."""
        law, filters = self.law, self._bank.filters
        repeated = law.model.repeated(self._tracks.velocities[rows])
        velocity = velocity._replace(covariance=repeated[:, None, None] * velocity.covariance)
        weight = self._standing.observe_velocity(rows, velocity, filters, law.failures)
        self._bank.update_velocity(rows, velocity, weight)
        self._tracks.velocities[rows] += 1

    def _weigh_headings(self, matched: Matched, seen: Detections, elapsed_s: float) -> None:
        """Tell front from rear by the detections, or turn every track that they contradict."""
        rows, columns = matched
        mean = self._bank.filters[0]
        if self.config.yaw == "published":
            offset = wrap_angle(seen.box[columns, YAW] - mean[rows, YAW])
            self._bank.flip_heading(rows[np.abs(offset) > np.pi / 2])
            return
        headings = DetectedHeadings(seen.boxes, seen.label)
        tracks = TrackHeadings(mean, self._bank.z_yaw_size_variance)
        self._headings.observe_detections(matched, headings, tracks, elapsed_s)

    def _turn_by_motion(self, rows: I64, elapsed_s: float) -> None:
        """Correct the headings of `rows` (n,) by the directions in which they move."""
        share = self._headings.share(elapsed_s)
        of_tracks = self._standing.rows.p_standing, self._table.slip_rad(self._tracks.label)
        course = self._headings.course(rows, Motion(*self._bank.filters, *of_tracks), share)
        self._bank.update_yaw(rows, *course)
        motion = Motion(*self._bank.filters, *of_tracks)
        self._bank.flip_heading(self._headings.observe_motion(rows, motion, share))

    def _initiate(self, columns: I64, seen: Detections, stamp_ns: int) -> None:
        """Start a track at each unmatched detection that may start one."""
        lowest = self.config.track_management.birth_score
        if lowest is not None:
            columns = columns[seen.score[columns] >= lowest]
        if len(columns) == 0:
            return
        new = seen.select(columns)
        noise = self._table.rows(new.label)
        replaced = new.has_velocity & (self.config.velocity.birth == "replace")
        mean = np.hstack([new.box, np.zeros((len(new), 4))])
        mean[replaced, VELOCITY] = new.velocity[replaced]
        covariance = initial_velocity_covariance(noise, new.box[:, YAW])
        covariance[replaced] = new.velocity_covariance[replaced]
        first = len(self._bank)
        self._bank.append(mean, noise.initial, covariance)
        names = [self._table.labels[index] for index in new.label.tolist()]
        standing = Hypotheses(new.box[:, :2], new.xy_covariance, self._standing.prior(names))
        self._standing.append(*standing)
        unseen = np.hstack([new.box, np.zeros((len(new), 4))])
        planar = planar_covariance(
            noise.initial, initial_velocity_covariance(noise, new.box[:, YAW])
        )
        self._test.append(Tracked(unseen, planar, standing))
        rows = new_tracks(self._next_id, new.label, new.score, stamp_ns)
        rows.source[:] = new.source
        self._headings.append(new.label)
        self._tracks.append(rows)
        self._next_id += len(new)
        updated = np.flatnonzero(new.has_velocity & ~replaced)
        self._update_velocity(first + updated, _velocities(new, updated))

    def _published(self, chosen: I64, stamp_ns: int, unit_s: float) -> Tracks:
        tracks, filters = self._tracks, self._bank.filters
        mean = filters[0][chosen]
        velocity = self._standing.velocities(chosen, filters)
        return Tracks(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=mean[:, :3],
            size_m=np.maximum(mean[:, SIZE], SMALLEST_SIZE_M),
            yaw_rad=mean[:, YAW],
            label=self._table.names(tracks.label[chosen]),
            id=tracks.id[chosen],
            score=self._management.score(tracks, stamp_ns)[chosen],
            velocity_mps=velocity.mean / unit_s,
            velocity_covariance_m2ps2=velocity.covariance / unit_s**2,
            state=mean,
            covariance=self._bank.covariance(chosen),
            observed=tracks.source[chosen] >= 0,
        )


def _velocities(seen: Detections, columns: I64) -> Observation:
    return Observation(seen.velocity[columns], seen.velocity_covariance[columns])

"""The tracker: predict, associate, correct, give birth, put out, bury."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.checks import as_stamp
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects, Tracks
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.bank import make_bank
from mottrack.trackers.kalman.carried_hulls import CarriedHulls
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.detections import Detections, read_detections
from mottrack.trackers.kalman.lifecycle import TrackManagement, record_hits
from mottrack.trackers.kalman.matching import match, others
from mottrack.trackers.kalman.noise_model import initial_velocity_covariance
from mottrack.trackers.kalman.noise_table import NoiseTable
from mottrack.trackers.kalman.pair_cost import heading_residual, innovation_squared
from mottrack.trackers.kalman.predicted import Predicted
from mottrack.trackers.kalman.state import BOX_SIZE, SIZE, SMALLEST_SIZE_M, VELOCITY, YAW
from mottrack.trackers.kalman.track_rows import TrackRows, new_tracks
from mottrack.trackers.kalman.velocity_belief import density, rest_odds

FLIP_LIMIT = 3
"""Votes that a heading can gather: more detections than this turn any box round."""


class KalmanTracker:
    """Tracks boxes of all classes in one batch (Chiu et al., 2020; PillarFlow, section IV-D).

    A new tracker is made for each scene. The world frame, seconds and metres a second throughout;
    the published presets count in frames inside and convert at the border.
    """

    Config = KalmanConfig

    def __init__(self, config: KalmanConfig | None = None) -> None:
        self.config = config or KalmanConfig()
        self._table = NoiseTable(self.config.noise)
        self._bank = make_bank(self.config)
        self._book = TrackRows.empty()
        self._life = TrackManagement(self.config.life)
        self._hulls = CarriedHulls()
        self._next_id = 1
        self._stamp_ns: int | None = None
        self.nis: F64 = np.empty(0)
        """Normalised squared innovations of the last step's boxes, 7 numbers each (`diagnose`)."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advances to `stamp_ns` with this step's objects (world frame) and returns the tracks.

        Raises:
            InputError: the stamp is not later than the last one, or the objects are not in the
                world frame; the tracker is then as it was.
        """
        elapsed_s = self._elapsed_s(stamp_ns)
        unit_s = elapsed_s if self.config.time == "frames" else 1.0
        seen = read_detections(objects, self.config, self._table, unit_s)
        self._stamp_ns = stamp_ns
        active = self._life.active(self._book.label, seen.label)
        self._predict(active, elapsed_s / unit_s)
        self._life.begin(self._book, seen.label, len(self._table.labels), elapsed_s)
        rows, columns = self._match(seen, np.flatnonzero(active))
        self._correct(rows, columns, seen)
        record_hits(self._book, rows, seen.score[columns], seen.source[columns], stamp_ns)
        self._bear(others(len(seen), columns), seen, stamp_ns)
        tracks = self._put_out(self._life.shown(self._book, seen.label, stamp_ns), stamp_ns, unit_s)
        tracks = self._hulls.on(tracks, self._book, objects)
        self._bury(self._life.alive(self._book, stamp_ns))
        return tracks

    def finish(self, steps: list[Tracks]) -> list[Tracks]:
        """The tracks of a finished scene: smoothed if the settings ask for it, else as they were.

        Raises:
            ConfigError: the settings count in frames or mix models, which cannot be retraced.
        """
        if not self.config.smooth:
            return steps
        # the smoother is built on this package's parts, and most trackers never need it
        from mottrack.trackers.kalman.smoothing import smooth

        return smooth(steps, self.config)

    def _elapsed_s(self, stamp_ns: int) -> float:
        stamp_ns = as_stamp("stamp_ns", stamp_ns)
        if self._stamp_ns is None:
            return self.config.frame_s if self.config.time == "frames" else 1.0
        if stamp_ns <= self._stamp_ns:
            raise InputError("stamp_ns", stamp_ns, f"later than the last step, {self._stamp_ns}")
        return (stamp_ns - self._stamp_ns) * 1e-9

    def _predict(self, active: Mask, duration: float) -> None:
        process = self._table.process[self._book.label]
        self._bank.predict(np.where(active, duration, 0.0), process)

    def _match(self, seen: Detections, active: I64) -> tuple[I64, I64]:
        bank = self._bank
        tracks = Predicted(
            bank.mean, bank.planar_covariance(), bank.axial_variance(), self._book.label
        )
        if len(active) < len(bank):
            tracks = tracks.select(active)
        rows, columns = match(seen, tracks, self.config, self._table.labels)
        if self.config.diagnose:
            self.nis = innovation_squared(seen, tracks, (columns, rows))
        return active[rows], columns

    def _correct(self, rows: I64, columns: I64, seen: Detections) -> None:
        """Kalman update of matched tracks by the box, then by the velocity where measured."""
        bank = self._bank
        residual = seen.box[columns] - bank.mean[rows, :BOX_SIZE]
        residual[:, YAW] = heading_residual(residual[:, YAW])
        self._turn(rows, seen.box[columns, YAW])
        bank.update_box(rows, residual, seen.position[columns], seen.axial[columns])
        moving = seen.moving[columns]
        if moving.any():
            rows, columns = rows[moving], columns[moving]
            believed = self._believable(rows, columns, seen)
            self._correct_velocity(rows[believed], columns[believed], seen)

    def _believable(self, rows: I64, columns: I64, seen: Detections) -> Mask:
        """Velocities that are likelier their tracks' than a failure of the source, (n,)."""
        mean, own = self._bank.mean[rows, VELOCITY], self._bank.planar_covariance()[rows, 2:, 2:]
        velocity, noise = seen.velocity[columns], seen.velocity_covariance[columns]
        sound = density(velocity - mean, own + noise)
        table = self._table.rows(seen.label[columns])
        prior = initial_velocity_covariance(table, seen.box[columns, YAW])
        rest = rest_odds(mean, own, prior, self.config.velocity.rest_prior)
        return np.asarray(sound + rest * density(velocity, noise) >= seen.no_news[columns])

    def _correct_velocity(self, rows: I64, columns: I64, seen: Detections) -> None:
        residual = seen.velocity[columns] - self._bank.mean[rows, VELOCITY]
        self._bank.update_velocity(rows, residual, seen.velocity_covariance[columns])

    def _turn(self, rows: I64, yaw_rad: F64) -> None:
        """Turns tracks round whose heading the detections contradict: at once, or by vote."""
        opposite = np.abs(wrap_angle(yaw_rad - self._bank.mean[rows, YAW])) > np.pi / 2
        if self.config.yaw == "vote":
            votes = self._book.flips[rows] + np.where(opposite, -1, 1)
            opposite = votes < 0
            self._book.flips[rows] = np.minimum(np.abs(votes), FLIP_LIMIT)
        self._bank.turn(rows[opposite])

    def _bear(self, columns: I64, seen: Detections, stamp_ns: int) -> None:
        """Starts a track at each unmatched detection that may start one."""
        lowest = self.config.life.birth_score
        if lowest is not None:
            columns = columns[seen.score[columns] >= lowest]
        if len(columns) == 0:
            return
        new = seen.select(columns)
        noise = self._table.rows(new.label)
        taken = new.moving & (self.config.velocity.birth == "replace")
        size = self._bank.size
        mean = np.hstack([new.box, np.zeros((len(new), size - BOX_SIZE))])
        mean[taken, VELOCITY] = new.velocity[taken]
        covariance = initial_velocity_covariance(noise, new.box[:, YAW])
        covariance[taken] = new.velocity_covariance[taken]
        first = len(self._bank)
        model = self.config.motion.index(self._table.labels)[new.label]
        self._bank.append(mean, noise.initial[:, :size], covariance, model)
        weighed = np.flatnonzero(new.moving & ~taken)
        weighed = weighed[self._believable(first + weighed, weighed, new)]
        self._correct_velocity(first + weighed, weighed, new)
        book = new_tracks(self._next_id, new.label, new.score, stamp_ns)
        book.source[:] = new.source
        self._book.append(book)
        self._next_id += len(new)

    def _put_out(self, shown: Mask, stamp_ns: int, unit_s: float) -> Tracks:
        book, mean = self._book, self._bank.mean[shown]
        source, covariance = book.source[shown], self._bank.covariance[shown]
        return Tracks(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=mean[:, :3],
            size_m=np.maximum(mean[:, SIZE], SMALLEST_SIZE_M),
            yaw_rad=mean[:, YAW],
            label=np.array(self._table.labels)[book.label[shown]],
            id=book.id[shown],
            score=self._life.score(book, stamp_ns)[shown],
            velocity_mps=mean[:, VELOCITY] / unit_s,
            velocity_covariance_m2ps2=covariance[:, VELOCITY, VELOCITY] / unit_s**2,
            state=mean,
            covariance=covariance,
            observed=source >= 0,
        )

    def _bury(self, alive: Mask) -> None:
        if not alive.all():
            self._bank.keep(alive)
            self._book.keep(alive)

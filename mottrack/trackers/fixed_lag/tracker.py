"""The class-agnostic tracker of section V-A: clusters in, smoothed tracks out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ConfigError, InputError
from mottrack.core.objects import Objects, Tracks
from mottrack.trackers.association import mahalanobis
from mottrack.trackers.fixed_lag import merge_split
from mottrack.trackers.fixed_lag.book import TrackBook
from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.engine import Belief, FixedLagEngine, SmoothedWindow
from mottrack.trackers.fixed_lag.matching import Matches, Predicted, match
from mottrack.trackers.fixed_lag.measurement import Measured, measured
from mottrack.trackers.fixed_lag.merge_split import Overlaps
from mottrack.trackers.fixed_lag.nodes import NodeBatch
from mottrack.trackers.fixed_lag.numpy_engine import NumpyEngine

I64 = NDArray[np.int64]


class _Known(NamedTuple):
    """Live tracks at the new stamp, before its objects are looked at."""

    slots: I64
    belief: Belief
    hulls: tuple[NDArray[np.float64], ...] | None
    """Predicted hulls; None where tracks have none."""


class FixedLagTracker:
    """Tracks objects of any shape by fixed-lag smoothing over a factor graph.

    Every associated object adds a state (x, y, vx, vy, ax, ay) to its track's chain, linked by the
    constant-acceleration model, with a position factor and, where the flow measured one, a velocity
    factor. Clusters (objects with hulls) may fall apart or run together; boxes work as well.
    """

    Config = FixedLagConfig

    def __init__(self, config: FixedLagConfig | None = None) -> None:
        self.config = config or FixedLagConfig()
        self._engine = make_engine(self.config)
        self._huber = self.config.robust.huber()
        self._book = TrackBook()
        self._stamp_ns: int | None = None

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advances to `stamp_ns` with these objects (world frame).

        An object that cannot be used (a covariance that is not definite, say) begins no track, and
        its track coasts; the others are not touched.

        Raises:
            InputError: the stamp is not later than the last one, or the objects are not in the
                world frame; nothing is changed then.
        """
        if objects.frame != "world":
            raise InputError("frame of objects", repr(objects.frame), "'world'")
        if self._stamp_ns is not None and stamp_ns <= self._stamp_ns:
            raise InputError("stamp_ns", stamp_ns, f"later than {self._stamp_ns}")
        self._stamp_ns = stamp_ns
        known = self._known(stamp_ns)
        objects, pairs = self._without_fragments(known, objects)
        measurements = measured(objects, self.config.measurement)
        held = self._hold_merged(known, pairs, stamp_ns)
        open_rows = np.nonzero(measurements.usable & ~held.objects)[0]
        matches = self._match(known, held.tracks, objects, measurements, open_rows)
        born = np.setdiff1d(open_rows, matches.object)
        heirs = merge_split.parents(pairs, born, self.config.merge_split.inside_share)
        measurements = self._inherit(known, heirs, measurements)
        fresh = self._adopt(known, held.tracks, (matches, pairs), heirs)
        seen = self._add_nodes(stamp_ns, known, objects, (matches, born, fresh, measurements))
        self._huber.refine(self._engine, seen)
        self._bury(stamp_ns)
        return self._published(stamp_ns, seen)

    def smoothed(self, track_id: int, covariance: bool = False) -> SmoothedWindow:
        """All states of a live track's window, given all measurements so far.

        Raises:
            InputError: no live track has that identity.
        """
        for slot, entry in self._book.entries.items():
            if entry.id == track_id:
                return self._engine.smooth(slot, covariance)
        live = sorted(entry.id for entry in self._book.entries.values())
        raise InputError("track_id", track_id, f"one of {live}")

    def _known(self, stamp_ns: int) -> _Known:
        slots = self._book.slots()
        belief = self._engine.predicted(slots, stamp_ns)
        hulls = []
        for slot, centre_m in zip(slots.tolist(), belief.mean[:, :2], strict=True):
            entry = self._book.entries[slot]
            if entry.hull is None:
                return _Known(slots, belief, None)
            hulls.append(entry.hull + (centre_m - entry.reference_m))
        return _Known(slots, belief, tuple(hulls))

    def _without_fragments(self, known: _Known, objects: Objects) -> tuple[Objects, Overlaps]:
        """The objects with the pieces of one split object joined again, and their overlaps."""
        config = self.config.merge_split
        if not config.enabled or known.hulls is None or objects.hull is None:
            return objects, merge_split.no_overlaps(len(known.slots), len(objects))
        pairs = merge_split.overlaps(known.hulls, objects.hull)
        groups = self._recent(known, merge_split.fragments(pairs, config), objects.stamp_ns)
        whole = merge_split.joined(objects, groups, pairs.track_area_m2, config.growth)
        if whole is not objects and whole.hull is not None:
            pairs = merge_split.overlaps(known.hulls, whole.hull)
        return whole, pairs

    def _recent(
        self, known: _Known, groups: list[tuple[int, I64]], stamp_ns: int
    ) -> list[tuple[int, I64]]:
        """Groups of pieces that have not been apart for too long: then they are two objects."""
        limit_ns = self.config.merge_split.hold_s * 1e9
        kept = []
        for track, group in groups:
            entry = self._book.entries[int(known.slots[track])]
            if entry.split_ns < 0:
                entry.split_ns = stamp_ns
            if stamp_ns - entry.split_ns <= limit_ns:
                kept.append((track, group))
        whole = set(range(len(known.slots))) - {track for track, _ in groups}
        for track in whole:
            self._book.entries[int(known.slots[track])].split_ns = -1
        return kept

    def _hold_merged(self, known: _Known, pairs: Overlaps, stamp_ns: int) -> _Held:
        """Lets tracks coast that share one merged cluster, for a limited time."""
        config = self.config.merge_split
        held = _Held(
            np.zeros(len(pairs.track_area_m2), np.bool_),
            np.zeros(len(pairs.object_area_m2), np.bool_),
        )
        for row, tracks in merge_split.merged(pairs, config):
            entries = [self._book.entries[int(slot)] for slot in known.slots[tracks]]
            grown = [entry for entry in entries if entry.hits >= self.config.life.min_hits]
            since_ns = [e.held_ns if e.held_ns >= 0 else stamp_ns for e in grown]
            if len(grown) < 2 or stamp_ns - min(since_ns) > config.hold_s * 1e9:
                continue
            for entry, start_ns in zip(grown, since_ns, strict=True):
                entry.held_ns = start_ns
            held.objects[row] = True
            held.tracks[tracks] = True
        return held

    def _match(
        self,
        known: _Known,
        held: NDArray[np.bool_],
        objects: Objects,
        measurements: Measured,
        rows: I64,
    ) -> Matches:
        free = np.nonzero(~held)[0]
        slots = known.slots[free]
        tracks = Predicted(
            Belief(known.belief.mean[free], known.belief.covariance[free]),
            self._book.labels(slots),
            self._slack_m2(slots, objects.stamp_ns),
        )
        noise = measurements.position_covariance_m2[rows]
        found = match(tracks, objects.select(rows), noise, self.config.association)
        return found._replace(track=free[found.track], object=rows[found.object])

    def _slack_m2(self, slots: I64, stamp_ns: int) -> NDArray[np.float64]:
        """(N,) how far young tracks may have gone if the flow that they began with was wrong."""
        entries = [self._book.entries[slot] for slot in slots.tolist()]
        limit = self.config.association.young_hits
        young = np.array([entry.hits < limit for entry in entries], np.bool_)
        dt_s = np.array([(stamp_ns - entry.seen_ns) * 1e-9 for entry in entries])
        reach_m = self.config.motion.birth_speed_sigma_mps * dt_s
        return np.where(young, reach_m**2, 0.0)

    def _add_nodes(
        self,
        stamp_ns: int,
        known: _Known,
        objects: Objects,
        outcome: tuple[Matches, I64, dict[int, int], Measured],
    ) -> I64:
        """One new state for every match and birth; returns the slots of those that were taken."""
        matches, born, adopted, measurements = outcome
        fresh = self._book.reserve(len(born) - len(adopted))
        born = np.concatenate([np.setdiff1d(born, list(adopted)), list(adopted)]).astype(np.int64)
        rows = np.concatenate([matches.object, born])
        heirs = np.array(list(adopted.values()), np.int64)
        slots = np.concatenate([known.slots[matches.track], fresh, heirs])
        birth = np.arange(len(rows)) >= len(matches.object)
        innovation = np.zeros((len(rows), 2))
        innovation[~birth, 0] = matches.distance
        surprise = _velocity_innovation(known.belief, matches, measurements)
        innovation[~birth, 1] = np.maximum(surprise, matches.doubt)
        batch = NodeBatch(
            stamp_ns=stamp_ns,
            slot=slots,
            birth=birth,
            position_m=objects.centre_m[rows, :2],
            position_covariance_m2=measurements.position_covariance_m2[rows],
            velocity_mps=measurements.velocity_mps[rows],
            velocity_covariance_m2ps2=measurements.velocity_covariance_m2ps2[rows],
            has_velocity=measurements.has_velocity[rows],
            weight=self._huber.weights(innovation),
            innovation=innovation,
        )
        taken = self._engine.step(batch)
        for slot in slots[~taken & birth].tolist():
            self._book.hand_back(slot)
        for slot, row in zip(slots[taken].tolist(), rows[taken].tolist(), strict=True):
            self._book.see(slot, objects, row)
        return slots[taken]

    def _inherit(self, known: _Known, heirs: dict[int, int], measurements: Measured) -> Measured:
        """Measurements in which pieces of a track without flow get that track's velocity."""
        rows = np.array([row for row in heirs if not measurements.has_velocity[row]], np.int64)
        tracks = np.array([heirs[row] for row in rows.tolist()], np.int64)
        own = known.belief.covariance[tracks, 2:4, 2:4]
        spread = own + self.config.merge_split.heir_sigma_mps**2 * np.eye(2)
        return measurements.with_velocity(rows, known.belief.mean[tracks, 2:4], spread)

    def _adopt(
        self,
        known: _Known,
        held: NDArray[np.bool_],
        found: tuple[Matches, Overlaps],
        heirs: dict[int, int],
    ) -> dict[int, int]:
        """Pieces that carry on a track whose own object is gone: row to slot, with a new chain.

        Such a piece lies beyond the gate because the reference point jumped, not the object.
        """
        matches, pairs = found
        lost = ~held
        lost[matches.track] = False
        largest: dict[int, tuple[float, int]] = {}
        for row, track in heirs.items():
            entry = self._book.entries[int(known.slots[track])]
            if lost[track] and entry.hits >= self.config.life.min_hits:
                candidate = (float(pairs.object_area_m2[row]), row)
                largest[track] = max(largest.get(track, candidate), candidate)
        adopted = {row: int(known.slots[track]) for track, (_, row) in largest.items()}
        for slot in adopted.values():
            self._engine.release(slot)
        return adopted

    def _bury(self, stamp_ns: int) -> None:
        """Ends tracks that were not seen for too long; merged ones have their own limit."""
        life, hold_s = self.config.life, self.config.merge_split.hold_s
        for slot in self._book.slots().tolist():
            entry = self._book.entries[slot]
            limit_s = life.max_age_s + (hold_s if entry.held_ns >= 0 else 0.0)
            if stamp_ns - entry.seen_ns > limit_s * 1e9:
                self._engine.release(slot)
                self._book.hand_back(slot)

    def _published(self, stamp_ns: int, seen: I64) -> Tracks:
        """Tracks with enough hits, at the stamp; coasting ones where the settings say so."""
        slots = self._book.slots()
        life = self.config.life
        observed = np.isin(slots, seen)
        old = np.array([self._book.entries[s].hits >= life.min_hits for s in slots.tolist()], bool)
        shown = old & (observed | life.publish_coasting)
        slots, observed = slots[shown], observed[shown]
        if len(slots) == 0:
            return Tracks.empty(stamp_ns, dimensions=6)
        entries = [self._book.entries[slot] for slot in slots.tolist()]
        belief = self._engine.predicted(slots, stamp_ns)
        moved_m = belief.mean[:, :2] - np.array([entry.reference_m for entry in entries])
        hulls = [e.hull for e in entries if e.hull is not None]
        hull = None
        if len(hulls) == len(entries):
            # a hull just measured stays where it was measured
            shift_m = np.where(observed[:, None], 0.0, moved_m)
            hull = tuple(h + shift for h, shift in zip(hulls, shift_m, strict=True))
        return Tracks(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=np.column_stack([belief.mean[:, :2], [entry.z_m for entry in entries]]),
            size_m=np.array([entry.size_m for entry in entries]),
            yaw_rad=np.array([entry.yaw_rad for entry in entries]),
            label=np.array([entry.label for entry in entries], np.str_),
            id=np.array([entry.id for entry in entries], np.int64),
            score=np.array([entry.score for entry in entries]),
            velocity_mps=belief.mean[:, 2:4],
            velocity_covariance_m2ps2=belief.covariance[:, 2:4, 2:4],
            state=belief.mean,
            covariance=belief.covariance,
            observed=observed,
            hull=hull,
        )


def _velocity_innovation(
    belief: Belief, matches: Matches, measurements: Measured
) -> NDArray[np.float64]:
    """(P,) normalised distance of measured from predicted velocity; 0 where none was measured."""
    seen = measurements.has_velocity[matches.object]
    rows, tracks = matches.object[seen], matches.track[seen]
    off = measurements.velocity_mps[rows] - belief.mean[tracks, 2:4]
    spread = belief.covariance[tracks, 2:4, 2:4] + measurements.velocity_covariance_m2ps2[rows]
    distance = np.zeros(len(seen))
    distance[seen] = mahalanobis(off, spread)
    return distance


class _Held(NamedTuple):
    """Who sits out this frame because clusters ran together."""

    tracks: NDArray[np.bool_]
    objects: NDArray[np.bool_]


def make_engine(config: FixedLagConfig) -> FixedLagEngine:
    """The engine that a configuration names.

    Raises:
        ConfigError: GTSAM is asked for where it is not installed (there is none for Windows).
    """
    noise, lag_ns = config.motion.noise(), round(config.lag_s * 1e9)
    if config.engine == "numpy":
        return NumpyEngine(noise, lag_ns)
    try:
        from mottrack.trackers.fixed_lag.gtsam_engine import GtsamEngine
    except ImportError as missing:
        raise ConfigError(
            f"engine 'gtsam': {missing}; install gtsam or use engine=numpy"
        ) from missing
    return GtsamEngine(noise, lag_ns, config.separate_factors)

"""The class-agnostic tracker of section V-A: clusters in, smoothed tracks out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import ConfigError, InputError
from mottrack.core.objects import Objects, Tracks
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.trackers.association import mahalanobis
from mottrack.trackers.fixed_lag import merge_split
from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.engine import Belief, Engine, SmoothedWindow
from mottrack.trackers.fixed_lag.matching import Matches, Predicted, Seen, match
from mottrack.trackers.fixed_lag.measurement import Measured, measured
from mottrack.trackers.fixed_lag.merge_split import Overlaps
from mottrack.trackers.fixed_lag.nodes import NodeBatch
from mottrack.trackers.fixed_lag.numpy_engine import NumpyEngine
from mottrack.trackers.fixed_lag.track_slots import TrackSlots


class _Known(NamedTuple):
    """Live tracks at the new stamp, before its objects are looked at."""

    slots: I64
    belief: Belief
    hulls: merge_split.HullList | None
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
        self._book = TrackSlots()
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
        error_model = NO_OUTLIERS if objects.velocity is None else objects.velocity.error_model
        self._huber.refine(self._engine, seen, error_model)
        self._bury(stamp_ns)
        return self._published(stamp_ns, seen)

    def smoothed(self, track_id: int, covariance: bool = False) -> SmoothedWindow:
        """All states of a live track's window, given all measurements so far.

        Raises:
            InputError: no live track has that identity.
        """
        slots = self._book.slots()
        live = self._book["id"][slots]
        if track_id not in live:
            raise InputError("track_id", track_id, f"one of {sorted(live.tolist())}")
        return self._engine.smooth(int(slots[live == track_id][0]), covariance)

    def _known(self, stamp_ns: int) -> _Known:
        slots = self._book.slots()
        belief = self._engine.predicted(slots, stamp_ns)
        moved_m = belief.mean[:, :2] - self._book["reference_m"][slots]
        return _Known(slots, belief, self._book.hulls_at(slots, moved_m))

    def _without_fragments(self, known: _Known, objects: Objects) -> tuple[Objects, Overlaps]:
        """The objects with the pieces of one split object joined again, and their overlaps."""
        config = self.config.merge_split
        if not config.enabled or known.hulls is None or objects.hull is None:
            return objects, merge_split.no_overlaps(len(known.slots), len(objects))
        pairs = merge_split.overlaps(known.hulls, merge_split.flat(objects.hull))
        groups = self._recent(known, merge_split.fragments(pairs, config), objects.stamp_ns)
        whole = merge_split.joined(objects, groups, pairs.track_area_m2, config.growth)
        if whole is not objects and whole.hull is not None:
            pairs = merge_split.overlaps(known.hulls, merge_split.flat(whole.hull))
        return whole, pairs

    def _recent(
        self, known: _Known, groups: list[tuple[int, I64]], stamp_ns: int
    ) -> list[tuple[int, I64]]:
        """Groups of pieces that have not been apart for too long: then they are two objects."""
        split_ns = self._book["split_ns"]
        apart = known.slots[[track for track, _ in groups]]
        split_ns[np.setdiff1d(known.slots, apart)] = -1
        split_ns[apart] = np.where(split_ns[apart] < 0, stamp_ns, split_ns[apart])
        since_ns = stamp_ns - split_ns[apart]
        recent = since_ns <= self.config.merge_split.hold_s * 1e9
        return [group for group, kept in zip(groups, recent, strict=True) if kept]

    def _hold_merged(self, known: _Known, pairs: Overlaps, stamp_ns: int) -> _Held:
        """Lets tracks coast that share one merged cluster, for a limited time."""
        config = self.config.merge_split
        held = _Held(
            np.zeros(len(pairs.track_area_m2), np.bool_),
            np.zeros(len(pairs.object_area_m2), np.bool_),
        )
        for row, tracks in merge_split.merged(pairs, config):
            slots = known.slots[tracks]
            grown = slots[self._book["hits"][slots] >= self.config.life.min_hits]
            held_ns = self._book["held_ns"][grown]
            since_ns = np.where(held_ns >= 0, held_ns, stamp_ns)
            if len(grown) < 2 or stamp_ns - since_ns.min() > config.hold_s * 1e9:
                continue
            self._book["held_ns"][grown] = since_ns
            held.objects[row] = True
            held.tracks[tracks] = True
        return held

    def _match(
        self,
        known: _Known,
        held: Mask,
        objects: Objects,
        measurements: Measured,
        rows: I64,
    ) -> Matches:
        free = np.nonzero(~held)[0]
        slots = known.slots[free]
        tracks = Predicted(
            Belief(known.belief.mean[free], known.belief.covariance[free]),
            self._book["label"][slots],
            self._slack_m2(slots, objects.stamp_ns),
        )
        seen = Seen(
            objects.centre_m[rows, :2],
            self._book.label_numbers(objects.label)[rows],
            measurements.position_covariance_m2[rows],
        )
        found = match(tracks, seen, self.config.association)
        return found._replace(track=free[found.track], object=rows[found.object])

    def _slack_m2(self, slots: I64, stamp_ns: int) -> F64:
        """(N,) how far young tracks may have gone if the flow that they began with was wrong."""
        young = self._book["hits"][slots] < self.config.association.young_hits
        dt_s = (stamp_ns - self._book["seen_ns"][slots]) * 1e-9
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
            extent_m=np.hypot(objects.size_m[rows, 0], objects.size_m[rows, 1]),
            weight=self._huber.weights(innovation),
            innovation=innovation,
        )
        taken = self._engine.step(batch)
        for slot in slots[~taken & birth].tolist():
            self._book.hand_back(slot)
        self._book.see(slots[taken], objects, rows[taken])
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
        held: Mask,
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
            hits = self._book["hits"][known.slots[track]]
            if lost[track] and hits >= self.config.life.min_hits:
                candidate = (float(pairs.object_area_m2[row]), row)
                largest[track] = max(largest.get(track, candidate), candidate)
        adopted = {row: int(known.slots[track]) for track, (_, row) in largest.items()}
        for slot in adopted.values():
            self._engine.release(slot)
        return adopted

    def _bury(self, stamp_ns: int) -> None:
        """Ends tracks that were not seen for too long; merged ones have their own limit."""
        slots, hold_s = self._book.slots(), self.config.merge_split.hold_s
        held = self._book["held_ns"][slots] >= 0
        limit_s = self.config.life.max_age_s + np.where(held, hold_s, 0.0)
        unseen_ns = stamp_ns - self._book["seen_ns"][slots]
        for slot in slots[unseen_ns > limit_s * 1e9].tolist():
            self._engine.release(slot)
            self._book.hand_back(slot)

    def _published(self, stamp_ns: int, seen: I64) -> Tracks:
        """Tracks with enough hits, at the stamp; coasting ones where the settings say so."""
        book, life = self._book, self.config.life
        slots = book.slots()
        observed = np.isin(slots, seen)
        shown = (book["hits"][slots] >= life.min_hits) & (observed | life.publish_coasting)
        slots, observed = slots[shown], observed[shown]
        if len(slots) == 0:
            return Tracks.empty(stamp_ns, dimensions=6)
        belief = self._engine.predicted(slots, stamp_ns)
        moved_m = belief.mean[:, :2] - book["reference_m"][slots]
        # a hull just measured stays where it was measured
        hulls = book.hulls_at(slots, np.where(observed[:, None], 0.0, moved_m))
        return Tracks(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=np.column_stack([belief.mean[:, :2], book["z_m"][slots]]),
            size_m=book["size_m"][slots],
            yaw_rad=book["yaw_rad"][slots],
            label=book.labels(slots),
            id=book["id"][slots],
            score=book["score"][slots],
            velocity_mps=belief.mean[:, 2:4],
            velocity_covariance_m2ps2=belief.covariance[:, 2:4, 2:4],
            state=belief.mean,
            covariance=belief.covariance,
            observed=observed,
            hull=None if hulls is None else hulls.polygons(),
        )


def _velocity_innovation(belief: Belief, matches: Matches, measurements: Measured) -> F64:
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

    tracks: Mask
    objects: Mask


def make_engine(config: FixedLagConfig) -> Engine:
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

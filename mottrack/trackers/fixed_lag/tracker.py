"""The class-agnostic tracker of section V-A: clusters in, smoothed tracks out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.concerns import Concern
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects, Tracks
from mottrack.core.sweep import SECOND_NS, seconds_between
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.trackers.fixed_lag import merge_split
from mottrack.trackers.fixed_lag.association import (
    REFERENCE_STEP_S,
    Matches,
    PredictedTracks,
    SeenObjects,
    associate_clusters,
    velocity_innovation,
)
from mottrack.trackers.fixed_lag.config import FixedLagConfig
from mottrack.trackers.fixed_lag.engine import Estimate, SmoothedWindow
from mottrack.trackers.fixed_lag.engine_choice import make_engine
from mottrack.trackers.fixed_lag.merge_split import Group, HullList, Overlaps
from mottrack.trackers.fixed_lag.nodes import Measurements, NodeBatch, measurements_of
from mottrack.trackers.fixed_lag.robust import RobustWeights
from mottrack.trackers.fixed_lag.track_slots import TrackSlots
from mottrack.trackers.fixed_lag.velocity_test import Judged, make_test
from mottrack.trackers.step_input import checked_stamp, is_gap
from mottrack.trackers.velocity_source.law import Law


class _Predicted(NamedTuple):
    """Live tracks (N) at the new stamp, before its objects are used."""

    slots: I64
    estimate: Estimate
    hulls: HullList | None
    """Predicted hulls; None where tracks have none."""


class _Merged(NamedTuple):
    """Tracks (N) and objects (M) that are left out of this step because clusters merged."""

    tracks: Mask
    objects: Mask


class _Assigned(NamedTuple):
    """What each object of a step is used for."""

    matches: Matches
    born: I64
    """Rows of objects that start tracks."""
    reassigned: dict[int, int]
    """Of these, those that continue a lost track: row to slot."""


class FixedLagTracker:
    """Tracks objects of any shape by fixed-lag smoothing over a factor graph.

    Every associated object adds a state (x, y, vx, vy, ax, ay) to its track's chain, linked by the
    constant-acceleration model, with a position factor and, where the flow measured one, a velocity
    factor. Clusters (objects with hulls) may split or merge; boxes work as well.
    """

    Config = FixedLagConfig

    def __init__(self, config: FixedLagConfig | None = None) -> None:
        self.config = config or FixedLagConfig()
        self._engine = make_engine(self.config)
        self._robust = RobustWeights(self.config.robust, self.config.missed_motion)
        self._test = make_test(self.config, self._engine)
        self._tracks = TrackSlots()
        self._stamp_ns: int | None = None
        self._step_s = 0.0
        """Length of the present step, at most `max_age_s`: older tracks are deleted anyway."""

    def step(self, stamp_ns: int, objects: Objects) -> Tracks:
        """Advance to `stamp_ns` with these objects (world frame) and return the tracks.

        An object that cannot be used (a covariance that is not positive definite, say) starts no
        track, and its track coasts; the others are not affected.

        Raises:
            InputError: the stamp is not later than the last one, or the objects are of another
                stamp or not in the world frame; nothing is changed then.
        """
        stamp_ns = checked_stamp(self._stamp_ns, stamp_ns, objects)
        if is_gap(self._stamp_ns, stamp_ns):
            self._delete(self._tracks.slots())
        if self._stamp_ns is not None:
            max_age_s = self.config.track_management.max_age_s
            self._step_s = min(seconds_between(self._stamp_ns, stamp_ns), max_age_s)
        self._stamp_ns = stamp_ns
        predicted = self._predict(stamp_ns)
        objects, pairs = self._join_fragments(predicted, objects)
        error_model = NO_OUTLIERS if objects.velocity is None else objects.velocity.error_model
        law = self._test.law(error_model)
        measurements = measurements_of(objects, self.config.measurement)
        merged = self._find_merged(predicted, pairs, stamp_ns)
        free_rows = np.nonzero(measurements.usable & ~merged.objects)[0]
        matches = self._associate(predicted, merged.tracks, objects, measurements, free_rows)
        born = np.setdiff1d(free_rows, matches.object)
        parents = merge_split.parents(pairs, born, self.config.merge_split.min_overlap)
        measured = measurements
        weighed = self._weighed(predicted, matches, measurements, law)
        measurements = self._propagate_velocity(predicted, parents, weighed)
        lost = ~merged.tracks
        lost[matches.track] = False
        reassigned = self._reassign(predicted, lost, pairs, parents)
        assigned = _Assigned(matches, born, reassigned)
        seen, rows = self._add_nodes(predicted, objects, assigned, measurements)
        self._test.learn(Judged(seen, rows, measured), law, self._step_s)
        self._robust.refine(self._engine, seen, law.error_model)
        self._delete_unseen(stamp_ns)
        return self._published(stamp_ns, seen)

    def velocity_concern(self) -> Concern | None:
        """Return a warning if the measured velocities were given little weight so far."""
        return self._test.concern()

    def smoothed(self, track_id: int, covariance: bool = False) -> SmoothedWindow:
        """Return all states of a live track's window, given all measurements so far.

        Raises:
            InputError: no live track has that identity.
        """
        slots = self._tracks.slots()
        live = self._tracks["id"][slots]
        if track_id not in live:
            raise InputError("track_id", track_id, f"one of {sorted(live.tolist())}")
        return self._engine.smooth(int(slots[live == track_id][0]), covariance)

    def _predict(self, stamp_ns: int) -> _Predicted:
        slots = self._tracks.slots()
        estimate = self._engine.predicted(slots, stamp_ns)
        moved_m = estimate.mean[:, :2] - self._tracks["reference_m"][slots]
        return _Predicted(slots, estimate, self._tracks.hulls_at(slots, moved_m))

    def _join_fragments(self, predicted: _Predicted, objects: Objects) -> tuple[Objects, Overlaps]:
        """Return the objects with the pieces of one split object joined, and their overlaps."""
        config = self.config.merge_split
        if not config.enabled or predicted.hulls is None or objects.hull is None:
            return objects, merge_split.no_overlaps(len(predicted.slots), len(objects))
        pairs = merge_split.overlaps(predicted.hulls, merge_split.flat(objects.hull))
        fragments = merge_split.fragments(pairs, config)
        groups = self._recently_split(predicted, fragments, objects.stamp_ns)
        whole = merge_split.joined(objects, groups, pairs.track_area_m2, config.max_growth)
        if whole is not objects and whole.hull is not None:
            pairs = merge_split.overlaps(predicted.hulls, merge_split.flat(whole.hull))
        return whole, pairs

    def _recently_split(
        self, predicted: _Predicted, groups: list[Group], stamp_ns: int
    ) -> list[Group]:
        """Return groups of pieces not separate for longer than tracks coast: then they are two."""
        split_ns = self._tracks["split_ns"]
        apart = predicted.slots[[group.owner for group in groups]]
        split_ns[np.setdiff1d(predicted.slots, apart)] = -1
        split_ns[apart] = np.where(split_ns[apart] < 0, stamp_ns, split_ns[apart])
        since_ns = stamp_ns - split_ns[apart]
        recent = since_ns <= self.config.merge_split.max_coast_s * SECOND_NS
        return [group for group, kept in zip(groups, recent, strict=True) if kept]

    def _find_merged(self, predicted: _Predicted, pairs: Overlaps, stamp_ns: int) -> _Merged:
        """Let tracks coast that share one merged cluster, for a limited time."""
        config = self.config.merge_split
        found = _Merged(
            np.zeros(len(pairs.track_area_m2), np.bool_),
            np.zeros(len(pairs.object_area_m2), np.bool_),
        )
        for row, tracks in merge_split.merged(pairs, config):
            slots = predicted.slots[tracks]
            confirmed = slots[self._tracks["hits"][slots] >= self.config.track_management.min_hits]
            merged_ns = self._tracks["merged_ns"][confirmed]
            since_ns = np.where(merged_ns >= 0, merged_ns, stamp_ns)
            if len(confirmed) < 2 or stamp_ns - since_ns.min() > config.max_coast_s * SECOND_NS:
                continue
            self._tracks["merged_ns"][confirmed] = since_ns
            found.objects[row] = True
            found.tracks[tracks] = True
        return found

    def _associate(
        self,
        predicted: _Predicted,
        merged: Mask,
        objects: Objects,
        measurements: Measurements,
        rows: I64,
    ) -> Matches:
        free = np.nonzero(~merged)[0]
        slots = predicted.slots[free]
        tracks = PredictedTracks(
            Estimate(predicted.estimate.mean[free], predicted.estimate.covariance[free]),
            self._tracks["label"][slots],
            self._inflation_m2(slots, objects.stamp_ns),
            self._scale(slots, measurements),
        )
        seen = SeenObjects(
            objects.centre_m[rows, :2],
            self._tracks.label_numbers(objects.label)[rows],
            measurements.position_covariance_m2[rows],
        )
        found = associate_clusters(tracks, seen, self.config.association)
        return found._replace(track=free[found.track], object=rows[found.object])

    def _inflation_m2(self, slots: I64, stamp_ns: int) -> F64:
        """Return the variance (N,) of young tracks' positions if their velocity was an outlier."""
        young = self._tracks["hits"][slots] < self.config.association.young_hits
        dt_s = seconds_between(self._tracks["seen_ns"][slots], stamp_ns)
        reach_m = self.config.motion.birth_speed_sigma_mps * dt_s
        return np.where(young, reach_m**2, 0.0)

    def _scale(self, slots: I64, measurements: Measurements) -> F64:
        """Return the step over `REFERENCE_STEP_S` for tracks (N,) of unknown velocity; else 1.

        Where the objects come with velocities, those are the better way to find a track again. An
        association over such a long step is uncertain: the track needs another hit for output.
        """
        scale = max(self._step_s / REFERENCE_STEP_S, 1.0)
        if scale == 1.0 or measurements.has_velocity.any():
            return np.ones(len(slots))
        unknown = ~self._tracks["velocity_known"][slots]
        self._tracks["extra_hits"][slots[unknown]] = 1
        return np.where(unknown, scale, 1.0)

    def _add_nodes(
        self,
        predicted: _Predicted,
        objects: Objects,
        assigned: _Assigned,
        measurements: Measurements,
    ) -> tuple[I64, I64]:
        """Add one state for every match and birth; return slots and objects that were usable."""
        matches, reassigned = assigned.matches, assigned.reassigned
        new = np.setdiff1d(assigned.born, list(reassigned))
        rows = np.concatenate([matches.object, new, np.array(list(reassigned), np.int64)])
        slots = np.concatenate(
            [
                predicted.slots[matches.track],
                self._tracks.reserve(len(new)),
                np.array(list(reassigned.values()), np.int64),
            ]
        )
        birth = np.arange(len(rows)) >= len(matches.object)
        innovation = np.zeros((len(rows), 2))
        innovation[~birth, 0] = matches.distance
        velocity_distance = velocity_innovation(predicted.estimate, matches, measurements)
        innovation[~birth, 1] = np.maximum(velocity_distance, matches.outlier_distance)
        batch = NodeBatch(
            stamp_ns=objects.stamp_ns,
            slot=slots,
            birth=birth,
            position_m=objects.centre_m[rows, :2],
            position_covariance_m2=measurements.position_covariance_m2[rows],
            velocity_mps=measurements.velocity_mps[rows],
            velocity_covariance_m2ps2=measurements.velocity_covariance_m2ps2[rows],
            has_velocity=measurements.has_velocity[rows],
            extent_m=np.hypot(objects.size_m[rows, 0], objects.size_m[rows, 1]),
            weight=self._robust.weights(innovation),
            innovation=innovation,
        )
        used = self._engine.step(batch)
        for slot in slots[~used & birth].tolist():
            self._tracks.release(slot)
        self._tracks.record(slots[used], objects, rows[used])
        measured = measurements.has_velocity[rows] | ~birth
        self._tracks["velocity_known"][slots[used]] |= measured[used]
        return slots[used], rows[used]

    def _weighed(
        self, predicted: _Predicted, matches: Matches, measurements: Measurements, law: Law
    ) -> Measurements:
        """Return velocities as wide as they err: more or less of what is likely to stand."""
        p_standing = np.full(len(measurements.usable), self.config.missed_motion.p_static)
        slots = predicted.slots[matches.track]
        p_standing[matches.object] = self._test.p_standing(slots)
        return measurements.widened(law.factor(p_standing))

    def _propagate_velocity(
        self, predicted: _Predicted, parents: dict[int, int], measurements: Measurements
    ) -> Measurements:
        """Return measurements in which split children without flow have their parent's velocity."""
        rows = np.array([row for row in parents if not measurements.has_velocity[row]], np.int64)
        tracks = np.array([parents[row] for row in rows.tolist()], np.int64)
        own = predicted.estimate.covariance[tracks, 2:4, 2:4]
        spread = own + self.config.merge_split.child_velocity_sigma_mps**2 * np.eye(2)
        return measurements.with_velocity(rows, predicted.estimate.mean[tracks, 2:4], spread)

    def _reassign(
        self, predicted: _Predicted, lost: Mask, pairs: Overlaps, parents: dict[int, int]
    ) -> dict[int, int]:
        """Return split children that continue a lost track with a new chain: row to slot.

        Such a piece lies beyond the gate because its centre jumped, not because the object moved.
        """
        largest: dict[int, tuple[float, int]] = {}
        for row, track in parents.items():
            hits = self._tracks["hits"][predicted.slots[track]]
            if lost[track] and hits >= self.config.track_management.min_hits:
                candidate = (float(pairs.object_area_m2[row]), row)
                largest[track] = max(largest.get(track, candidate), candidate)
        found = {row: int(predicted.slots[track]) for track, (_, row) in largest.items()}
        for slot in found.values():
            self._engine.release(slot)
        return found

    def _delete_unseen(self, stamp_ns: int) -> None:
        """Delete tracks that were not seen for too long; merged ones coast for longer."""
        slots = self._tracks.slots()
        merged = self._tracks["merged_ns"][slots] >= 0
        extra_s = np.where(merged, self.config.merge_split.max_coast_s, 0.0)
        limit_s = self.config.track_management.max_age_s + extra_s
        unseen_ns = stamp_ns - self._tracks["seen_ns"][slots]
        self._delete(slots[unseen_ns > limit_s * SECOND_NS])

    def _delete(self, slots: I64) -> None:
        for slot in slots.tolist():
            self._engine.release(slot)
            self._tracks.release(slot)

    def _published(self, stamp_ns: int, seen: I64) -> Tracks:
        """Return tracks with enough hits at the stamp; coasting ones where the settings say so."""
        tracks, management = self._tracks, self.config.track_management
        slots = tracks.slots()
        observed = np.isin(slots, seen)
        needed = management.min_hits + tracks["extra_hits"][slots]
        is_published = tracks["hits"][slots] >= needed
        is_published &= observed | management.publish_coasting
        slots, observed = slots[is_published], observed[is_published]
        if len(slots) == 0:
            return Tracks.empty(stamp_ns, dimensions=6)
        estimate = self._engine.predicted(slots, stamp_ns)
        moved_m = estimate.mean[:, :2] - tracks["reference_m"][slots]
        # a hull just measured stays where it was measured
        hulls = tracks.hulls_at(slots, np.where(observed[:, None], 0.0, moved_m))
        return Tracks(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=np.column_stack([estimate.mean[:, :2], tracks["z_m"][slots]]),
            size_m=tracks["size_m"][slots],
            yaw_rad=tracks["yaw_rad"][slots],
            label=tracks.labels(slots),
            id=tracks["id"][slots],
            score=tracks["score"][slots],
            velocity_mps=estimate.mean[:, 2:4],
            velocity_covariance_m2ps2=estimate.covariance[:, 2:4, 2:4],
            state=estimate.mean,
            covariance=estimate.covariance,
            observed=observed,
            hull=None if hulls is None else hulls.polygons(),
        )

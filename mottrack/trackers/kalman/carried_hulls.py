"""Hulls of clusters, for trackers whose own state is a box."""

from __future__ import annotations

from dataclasses import replace

from mottrack.core.arrays import F64
from mottrack.core.objects import Objects, Tracks
from mottrack.trackers.kalman.track_rows import TrackRows


class CarriedHulls:
    """The hull with which each live track was last seen."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[F64, F64]] = {}

    def on(self, tracks: Tracks, book: TrackRows, objects: Objects) -> Tracks:
        """The tracks with hulls, where the objects of this step have them; else as they are.

        A hull seen at this stamp stays where it was measured, another moves with its track's
        centre. `book` holds all live tracks, those not shown included.
        """
        if objects.hull is None:
            return tracks
        live = dict(zip(book.id.tolist(), book.source.tolist(), strict=True))
        self._last = {id_: self._last[id_] for id_ in live if id_ in self._last}
        for id_, row in live.items():
            if row >= 0:
                self._last[id_] = (objects.hull[row], objects.centre_m[row, :2])
        hulls = []
        shown = zip(tracks.id.tolist(), tracks.centre_m[:, :2], strict=True)
        for id_, centre_m in shown:
            if id_ not in self._last:
                return tracks
            hull, reference_m = self._last[id_]
            hulls.append(hull if live[id_] >= 0 else hull + (centre_m - reference_m))
        return replace(tracks, hull=tuple(hulls))

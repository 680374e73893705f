"""Tracks of any tracker, read from a file and brought to the frames of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mottrack.core.arrays import I64, Mask, Texts
from mottrack.core.checks import Column, Columns
from mottrack.core.tables import TrackTable
from mottrack.datasets.scene_boxes import DetectionTable


@dataclass(frozen=True, slots=True)
class ImportedTracks(DetectionTable):
    """Tracks of a scene, world frame; `frame` counts the frames that the reader was given.

    track: (N,) identity as the file has it, text; the same in two files means two tracks.
    observed: (N,) whether the tracker says that the box was detected, true where it does not say.
    """

    COLUMNS: ClassVar[Columns] = {
        **DetectionTable.COLUMNS,
        "track": Column(np.str_),
        "observed": Column(np.bool_),
    }

    track: Texts
    observed: Mask

    def renamed(self, prefix: str) -> ImportedTracks:
        """Return the tracks with other names: those of another file are other tracks."""
        columns = {name: getattr(self, name) for name in self.COLUMNS}
        named = [f"{prefix}{name}" for name in self.track.tolist()]
        return ImportedTracks(**columns | {"track": np.array(named, np.str_)})

    def table(self) -> TrackTable:
        """Return the tracks as stored in a result, in order of their frame.

        Numbers stay identities where all are numbers and each says one class; else tracks are
        numbered in order of their name.
        """
        order = np.argsort(self.frame, kind="stable")
        rows = self.select(order)
        return TrackTable(
            frame=rows.frame,
            id=_identities(rows.track),
            label=rows.label,
            centre_m=rows.centre_m,
            size_m=rows.size_m,
            yaw_rad=rows.yaw_rad,
            velocity_mps=rows.velocity_mps,
            velocity_covariance_m2ps2=np.zeros((len(rows), 2, 2)),
            score=rows.score,
            observed=rows.observed,
            hull_corners=np.zeros(len(rows), np.int64),
        )


MAX_DIGITS = 15
"""Of an identity that stays a number: the player's are exact so far."""


def _identities(names: Texts) -> I64:
    unique, inverse = np.unique(names, return_inverse=True)
    plain = all(n.isascii() and n.isdecimal() and len(n) <= MAX_DIGITS for n in unique.tolist())
    if plain and len({int(n) for n in unique.tolist()}) == len(unique):
        return unique.astype(np.int64)[inverse]
    return inverse.astype(np.int64)

"""Tracking submissions of any tracker, in the official format."""

from __future__ import annotations

import numpy as np

from mottrack.core.errors import DataError
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.nuscenes.detections import DetectionFile
from mottrack.formats.table_stream import Row


class TrackingFile(DetectionFile):
    """The tracks of each sample of a tracking submission."""

    NAME, SCORE = "tracking_name", "tracking_score"

    @property
    def known(self) -> tuple[str, ...]:
        """The classes that are tracked."""
        return self._dialect.classes

    def tracks(self, sample_tokens: list[str]) -> ImportedTracks | None:
        """Return the tracks of these samples; `frame` counts the samples.

        None if the file has none of the samples.

        Raises:
            DataError: the file is damaged, lacks some of the samples, or has a track twice in one.
        """
        if not self.holds(sample_tokens):
            return None
        parts = []
        for frame, token in enumerate(sample_tokens):
            boxes = self._boxes(frame, token)
            track = self._identities(token, self._rows(token))
            columns = {name: getattr(boxes, name) for name in boxes.COLUMNS}
            observed = np.ones(len(boxes), np.bool_)
            parts.append(
                ImportedTracks(**columns, track=np.array(track, np.str_), observed=observed)
            )
        return ImportedTracks.stacked(parts)

    def _identities(self, token: str, rows: list[Row]) -> list[str]:
        """Return the identity of each box; devkit and peers write text or whole numbers."""
        names: list[str] = []
        for index, row in enumerate(rows):
            value = row.get("tracking_id")
            good = isinstance(value, str | int) and not isinstance(value, bool)
            place = f"results[{token}][{index}].tracking_id"
            if not good or value == "" or not str(value).isprintable():
                raise DataError(self.path, place, value, "text or a whole number")
            names.append(str(value))
        if len(set(names)) != len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            expected = "each track once a sample"
            raise DataError(self.path, f"results[{token}].tracking_id", twice, expected)
        return names

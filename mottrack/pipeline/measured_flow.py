"""Whether the flow source of a run measures anything at all."""

from __future__ import annotations

from mottrack.core.concerns import Concern
from mottrack.pipeline.stream import Step

FEWEST_FIELDS = 10
"""A second of fields at 10 Hz: the first ones of a scene may well be without a measurement."""


class MeasuredFlow:
    """Counts the fields in which a flow source measured anything."""

    def __init__(self) -> None:
        self._fields, self._measured = 0, 0
        self._first_ns = 0

    def add(self, step: Step) -> None:
        """Take the next step; one without a field, or without an obstacle, says nothing."""
        if step.field is not None and step.field.occupied.any():
            self._first_ns = self._first_ns if self._fields else step.field.stamp_ns
            self._fields += 1
            self._measured += bool(step.field.valid.any())

    def concerns(self) -> list[Concern]:
        """Return a concern if nothing was measured in any of many fields."""
        if self._fields < FEWEST_FIELDS or self._measured:
            return []
        text = f"at frame {self._first_ns}: no cell of any field has a velocity"
        return [Concern("frames in which the flow measured nothing", self._fields, text)]

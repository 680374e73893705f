"""The detections of a data set as objects."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import ObjectSourceBase
from mottrack.core.objects import Objects
from mottrack.core.sweep import Sweep


class DetectionsConfig(StrictModel):
    """Which detections the tracker receives."""

    min_score: float = Field(default=-1e9, description="detections below this score are dropped")
    classes: tuple[str, ...] | None = Field(default=None, description="null: every class")


class DetectionSource(ObjectSourceBase):
    """The data set's detections."""

    Config = DetectionsConfig
    needs_sweeps = False
    needs_detections = True

    def __init__(self, config: DetectionsConfig | None = None) -> None:
        self.config = config or DetectionsConfig()

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Return the frame's detections, world frame.

        Raises:
            InputError: the data set has no detections.
        """
        del sweep  # detections alone
        if frame.detections is None:
            raise InputError("detections", "absent", "a data set with detections, or clusters")
        found = frame.detections
        keep = found.score >= self.config.min_score
        if self.config.classes is not None:
            keep &= np.isin(found.label, self.config.classes)
        return found if keep.all() else found.select(keep)

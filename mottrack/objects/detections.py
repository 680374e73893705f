"""Objects as a detector reports them."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.objects import Objects
from mottrack.core.sweep import Sweep


class DetectionsConfig(StrictModel):
    """Which detections are handed to the tracker."""

    min_score: float = Field(default=-1e9, description="detections below this score are dropped")
    classes: tuple[str, ...] | None = Field(default=None, description="None: every class")


class DetectionSource:
    """Passes the data set's detections on."""

    Config = DetectionsConfig
    needs_sweeps = False
    needs_detections = True

    def __init__(self, config: DetectionsConfig | None = None) -> None:
        self.config = config or DetectionsConfig()

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """The frame's detections, world frame.

        Raises:
            InputError: the data set has no detections.
        """
        if frame.detections is None:
            raise InputError("detections", "absent", "a data set with detections, or clusters")
        found = frame.detections
        keep = found.score >= self.config.min_score
        if self.config.classes is not None:
            keep &= np.isin(found.label, self.config.classes)
        return found if keep.all() else found.select(keep)

    def reset(self) -> None:
        """Nothing to forget."""

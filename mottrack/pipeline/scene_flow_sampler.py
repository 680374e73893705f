"""Scene flow of a run: the fields that its tracker used, point by point against annotated tracks.

The figures are those of `mottrack eval sceneflow` with time turned: a run measures where the points
of a sweep came FROM, so the displacement to the frame before is compared.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from mottrack.core.frame import Frame
from mottrack.core.interfaces import Scene
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.eval.sceneflow.sums import SceneFlowSums, frame_sums, total
from mottrack.pipeline.once import Once
from mottrack.pipeline.scene_flow import LONGEST_STEP_S, Pair, TruePoints, evaluated


class SharedTruth:
    """The true motion of the points of a sweep, looked up once for all runs of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.points: Once[TruePoints] = Once(self._points)

    def _points(self, now: Frame, before: Frame, sweep: Sweep) -> TruePoints:
        return TruePoints.of(Pair(now, before), sweep.select(evaluated(self._scene, sweep)))


@dataclass
class SceneFlowSampler:
    """Sums the errors of one run over the key frames of a scene."""

    truth: SharedTruth
    enabled: bool
    _before: Frame | None = None
    """The last annotated frame."""
    _sums: list[SceneFlowSums] = field(default_factory=list)

    def collect(self, frame: Frame, sweep: Sweep | None, found: FlowField | None) -> None:
        """Compare the field of a key frame, and remember every annotated frame, in order.

        Args:
            frame: the current frame.
            sweep: of the same stamp.
            found: the field at it; None between key frames and where no pair of sweeps is there.
        """
        before = self._before
        if not self.enabled or frame.truth is None:
            return
        self._before = frame
        if before is None or sweep is None or found is None or not frame.is_key:
            return
        if seconds_between(before.stamp_ns, frame.stamp_ns) <= LONGEST_STEP_S:
            points = self.truth.points(frame, before, sweep)
            self._sums.append(frame_sums(points.estimated(found)))

    def sums(self) -> SceneFlowSums | None:
        """Return the sums of the scene; None where nothing was compared."""
        return total(self._sums) if self._sums else None

"""What has been read of a scene, as flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from mottrack.core import Boxes, Frame, SceneResult
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.concerns import Concern
from mottrack.core.tables import TrackTable, TruthTable


@dataclass(frozen=True)
class SeenBoxes:
    """Boxes of all frames in the world; `frame` is the index of each one's frame.

    frame: (N,). label: (N,). centre_m: (N, 3). yaw_rad: (N,).
    """

    frame: I64
    label: Texts
    centre_m: F64
    yaw_rad: F64

    def __len__(self) -> int:
        return len(self.frame)

    @classmethod
    def of(cls, boxes: Sequence[Boxes | None]) -> Self:
        """Gather the boxes of every frame, None where there are none."""
        present = [(index, b) for index, b in enumerate(boxes) if b is not None]
        return cls(
            frame=np.repeat([i for i, _ in present], [len(b) for _, b in present]).astype(np.int64),
            label=np.concatenate([np.zeros(0, "U1"), *(b.label for _, b in present)]),
            centre_m=np.concatenate([np.zeros((0, 3)), *(b.centre_m for _, b in present)]),
            yaw_rad=np.concatenate([np.zeros(0), *(b.yaw_rad for _, b in present)]),
        )

    @classmethod
    def of_table(cls, table: TruthTable | TrackTable) -> Self:
        """Take the boxes of a stored result."""
        return cls(table.frame, table.label, table.centre_m, table.yaw_rad)


@dataclass(frozen=True)
class SeenTruth:
    """True boxes with what only those have.

    identity: (N,). velocity_mps: (N, 2), NaN where unknown. points: (N,) returns, -1: unknown.
    """

    boxes: SeenBoxes
    identity: I64
    velocity_mps: F64
    points: I64


@dataclass(frozen=True)
class SeenScene:
    """A scene as it was read, or as a run has stored it.

    stamp_ns: (F,). poses: (F, 4, 4) `world_T_ego`. is_key: (F,) whether trackers step.
    classes: labels that are scored; none: any.
    found: detections, or the tracks of a stored result. found_name: which of the two.
    """

    stamp_ns: I64
    poses: F64
    is_key: Mask
    classes: tuple[str, ...]
    truth: SeenTruth
    found: SeenBoxes
    found_name: str = "detections"

    @classmethod
    def of_frames(cls, frames: Sequence[Frame], classes: tuple[str, ...]) -> Self:
        """Gather at least one frame, in the order in which they were read."""
        truths = [frame.truth for frame in frames if frame.truth is not None]
        truth = SeenTruth(
            SeenBoxes.of([frame.truth for frame in frames]),
            np.concatenate([np.zeros(0, np.int64), *(t.id for t in truths)]),
            np.concatenate([np.zeros((0, 2)), *(t.velocity_mps for t in truths)]),
            np.concatenate([np.zeros(0, np.int64), *(t.num_points for t in truths)]),
        )
        return cls(
            np.array([frame.stamp_ns for frame in frames], dtype=np.int64),
            np.stack([frame.world_T_ego.matrix for frame in frames]),
            np.array([frame.is_key for frame in frames], dtype=bool),
            classes,
            truth,
            SeenBoxes.of([frame.detections for frame in frames]),
        )

    @classmethod
    def of_result(cls, result: SceneResult) -> Self:
        """Take a stored result, which holds key frames, truth and tracks."""
        table = result.truth
        truth = SeenTruth(SeenBoxes.of_table(table), table.id, table.velocity_mps, table.num_points)
        return cls(
            result.frames.stamp_ns,
            result.frames.world_T_ego,
            np.ones(len(result.frames), dtype=bool),
            result.classes,
            truth,
            SeenBoxes.of_table(result.tracks),
            "tracks",
        )

    def concern(self, kind: str, wrong: Mask, frame: I64, example: str) -> list[Concern]:
        """Return one concern if any entry (N,) is wrong; `frame` (N,) says where each one is."""
        if not wrong.any():
            return []
        place = f"at frame {self.stamp_ns[frame[int(np.argmax(wrong))]]}"
        text = f"{place}: {example}" if example else place
        return [Concern(kind, int(np.count_nonzero(wrong)), text)]

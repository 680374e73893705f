"""What has been read of a scene, as flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mottrack.core import Boxes, Frame, Objects, Truth
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.concerns import Concern


@dataclass(frozen=True)
class SeenBoxes:
    """Boxes of all frames in the world; `frame` is the index of each one's frame.

    frame: (N,). label: (N,). centre_m, size_m: (N, 3). yaw_rad: (N,).
    """

    frame: I64
    label: Texts
    centre_m: F64
    size_m: F64
    yaw_rad: F64

    def __len__(self) -> int:
        return len(self.frame)

    @classmethod
    def of(cls, boxes: Sequence[Boxes | None]) -> SeenBoxes:
        """Gather the boxes of every frame, None where there are none."""
        present = [(index, b) for index, b in enumerate(boxes) if b is not None]
        return cls(
            frame=np.repeat([i for i, _ in present], [len(b) for _, b in present]).astype(np.int64),
            label=np.concatenate([np.zeros(0, "U1"), *(b.label for _, b in present)]),
            centre_m=np.concatenate([np.zeros((0, 3)), *(b.centre_m for _, b in present)]),
            size_m=np.concatenate([np.zeros((0, 3)), *(b.size_m for _, b in present)]),
            yaw_rad=np.concatenate([np.zeros(0), *(b.yaw_rad for _, b in present)]),
        )


@dataclass(frozen=True)
class SeenScene:
    """The frames of a scene in the order in which they were read."""

    frames: Sequence[Frame]
    classes: tuple[str, ...]

    @cached_property
    def stamp_ns(self) -> I64:
        """Stamps (F,)."""
        return np.array([frame.stamp_ns for frame in self.frames], dtype=np.int64)

    @cached_property
    def poses(self) -> F64:
        """Poses `world_T_ego` (F, 4, 4)."""
        return np.stack([frame.world_T_ego.matrix for frame in self.frames])

    @cached_property
    def truths(self) -> list[Truth | None]:
        """The truth of each frame."""
        return [frame.truth for frame in self.frames]

    @cached_property
    def found(self) -> list[Objects | None]:
        """The detections of each frame."""
        return [frame.detections for frame in self.frames]

    @cached_property
    def truth(self) -> SeenBoxes:
        """All true boxes."""
        return SeenBoxes.of(self.truths)

    @cached_property
    def detections(self) -> SeenBoxes:
        """All detections."""
        return SeenBoxes.of(self.found)

    @cached_property
    def identity(self) -> I64:
        """Identity (N,) of each true box."""
        ids = [truth.id for truth in self.truths if truth is not None]
        return np.concatenate([np.zeros(0, np.int64), *ids])

    @cached_property
    def velocity_mps(self) -> F64:
        """Velocity (N, 2) of each true box, NaN where unknown."""
        values = [truth.velocity_mps for truth in self.truths if truth is not None]
        return np.concatenate([np.zeros((0, 2)), *values])

    def concern(self, kind: str, wrong: Mask, frame: I64, example: str) -> list[Concern]:
        """Return one concern if any entry (N,) is wrong; `frame` (N,) says where each one is."""
        if not wrong.any():
            return []
        row = int(np.argmax(wrong))
        place = f"at frame {self.stamp_ns[frame[row]]}"
        text = f"{place}: {example}" if example else place
        return [Concern(kind, int(np.count_nonzero(wrong)), text)]

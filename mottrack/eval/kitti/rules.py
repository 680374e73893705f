"""Rules of the protocol."""

from dataclasses import dataclass
from typing import Literal

Measure = Literal["3d", "2d"]

VAL_SEQUENCES = (
    "0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019",
)  # fmt: skip
SPLITS = {
    "val": VAL_SEQUENCES,
    "train": tuple(f"{n:04d}" for n in range(21) if f"{n:04d}" not in VAL_SEQUENCES),
    "trainval": tuple(f"{n:04d}" for n in range(21)),
}
"""Sequences of KITTI's training half; "val" is the one of AB3DMOT's tables."""
CLASSES = ("car", "pedestrian", "cyclist")
NEIGHBOURS = {"car": ("van",), "pedestrian": ("person_sitting",), "cyclist": ()}
"""Classes so near that neither finding nor missing one of them counts."""
DEFAULT_IOU: dict[Measure, float] = {"3d": 0.25, "2d": 0.5}


@dataclass(frozen=True, slots=True)
class KittiRules:
    """What is evaluated and how."""

    kind: str = "car"
    """The class, lower case."""
    measure: Measure = "3d"
    """Overlap of boxes in space, or of their rectangles in the image."""
    min_iou: float = 0.25
    max_occlusion: float = 2
    max_truncation: float = 0
    min_height_px: float = 25
    """Result boxes lower than this that match nothing are not false positives."""
    dont_care_share: float = 0.5
    levels: int = 40

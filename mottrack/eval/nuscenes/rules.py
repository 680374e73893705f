"""Rules of the official tracking evaluation (configuration tracking_nips_2019)."""

from dataclasses import dataclass
from typing import Any, Literal

from mottrack.formats.nuscenes_classes import CLASSES

Interpolation = Literal["official", "fixed"]
Arithmetic = Literal["recorded", "machine"]

MAX_BOXES_PER_SAMPLE = 500
"""Of the official configuration, like the ranges and the worst values below."""
FRAME_SECONDS = 0.5
"""The official code counts frames and takes each for half a second (key frames, 2 Hz)."""

LEVEL_METRICS = (
    "gt", "tp", "motar", "mota", "motp", "faf", "mt", "ml", "fp", "fn", "ids", "frag", "recall",
    "tid", "lgd",
)  # fmt: skip
"""The metrics that have a value at each recall level."""
SUMMARY_METRICS = (
    "amota", "amotp", "recall", "motar", "gt", "mota", "motp", "mt", "ml", "faf", "tp", "fp",
    "fn", "ids", "frag", "tid", "lgd",
)  # fmt: skip
SUMMED_METRICS = ("mt", "ml", "tp", "fp", "fn", "ids", "frag")
"""Added over the classes in the total; of all others, gt included, the mean is taken."""

METRIC_WORST = {
    "amota": 0.0, "amotp": 2.0, "recall": 0.0, "motar": 0.0, "mota": 0.0, "motp": 2.0, "mt": 0.0,
    "ml": -1.0, "faf": 500, "gt": -1, "tp": 0.0, "fp": -1.0, "fn": -1.0, "ids": -1.0,
    "frag": -1.0, "tid": 20, "lgd": 20,
}  # fmt: skip
"""Value of a metric for a class that reaches no recall level; -1: decided from the truth."""

COLORS = {
    "bicycle": "C9", "bus": "C2", "car": "C0", "motorcycle": "C6", "pedestrian": "C5",
    "trailer": "C3", "truck": "C1",
}  # fmt: skip
RANGES_M = {
    "car": 50, "truck": 50, "bus": 50, "trailer": 50, "pedestrian": 40, "motorcycle": 40,
    "bicycle": 40,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rules:
    """What is evaluated and how; the defaults are the official ones."""

    classes: tuple[str, ...] = CLASSES
    ranges_m: tuple[float, ...] = tuple(float(RANGES_M[name]) for name in CLASSES)
    """Per class: boxes at least this far from the ego vehicle are dropped."""
    match_distance_m: float = 2.0
    min_recall: float = 0.1
    levels: int = 40
    interpolation: Interpolation = "official"
    """How gaps in tracks are filled. "official" swaps the weights of the two neighbours, as the
    devkit does (its issue 1141); "fixed" is linear interpolation."""
    arithmetic: Arithmetic = "recorded"
    """How the official distance rounds, which depends on the processor: "recorded" is the same on
    every machine, "machine" is what the devkit does on this one (see `products`)."""

    @classmethod
    def for_classes(cls, classes: tuple[str, ...]) -> "Rules":
        """Return the same rules for other classes, without a limit of range."""
        return cls(classes=classes, ranges_m=(float("inf"),) * len(classes))

    def as_official_config(self) -> dict[str, Any]:
        """Return the configuration as the devkit writes it into metrics_summary.json."""
        return {
            "tracking_names": list(self.classes),
            "pretty_tracking_names": {name: name.capitalize() for name in self.classes},
            "tracking_colors": {name: COLORS.get(name, "C0") for name in self.classes},
            "class_range": {n: RANGES_M.get(n, -1) for n in (*RANGES_M,) if n in self.classes},
            "dist_fcn": "center_distance",
            "dist_th_tp": self.match_distance_m,
            "min_recall": self.min_recall,
            "max_boxes_per_sample": MAX_BOXES_PER_SAMPLE,
            "metric_worst": METRIC_WORST,
            "num_thresholds": self.levels,
        }

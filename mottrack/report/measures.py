"""What is measured: the name, the definition and the better direction of every figure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """A figure that the report shows."""

    key: str
    """Its name in ``ClassScores.as_dict``, ``ErrorRow`` or ``FlowError``."""
    name: str
    definition: str
    lower_is_better: bool | None = None
    """None where neither direction is better."""
    digits: int = 3
    unit: str = ""

    @property
    def anchor(self) -> str:
        """Where the glossary explains it."""
        return f"def-{self.key}"

    def text(self, value: float) -> str:
        """The value as a table shows it."""
        if value != value:
            return "–"
        if self.unit == "%":
            return f"{100 * value:.{self.digits}f} %"
        return f"{value:.{0 if isinstance(value, int) else self.digits}f}".replace("-", "−")


TRACKING = (
    Measure(
        "amota",
        "AMOTA",
        "Average multi-object tracking accuracy: the mean of MOTAR (MOTA, with the misses that the "
        "recall asked for allows taken out) over 40 levels of recall, then over classes. The score "
        "that nuScenes ranks by. It weighs the whole range of score thresholds.",
        lower_is_better=False,
    ),
    Measure(
        "amotp_m",
        "AMOTP",
        "Average multi-object tracking precision: the mean distance of matched centres over the "
        "same levels of recall. A level that is never reached counts 2 m.",
        lower_is_better=True,
        unit="m",
    ),
    Measure(
        "mota",
        "MOTA",
        "1 − (misses + false positives + identity switches) / true boxes, at the score threshold "
        "of each class where it is highest.",
        lower_is_better=False,
    ),
    Measure(
        "motp_m",
        "MOTP",
        "Mean distance between the centres of matched boxes at that threshold (1 − IoU where boxes "
        "are matched by overlap).",
        lower_is_better=True,
        unit="m",
    ),
    Measure(
        "idf1",
        "IDF1",
        "F1 of boxes under the one assignment of tracks to objects, fixed for a whole scene, that "
        "agrees most: rewards keeping one identity for long.",
        lower_is_better=False,
    ),
    Measure(
        "hota",
        "HOTA",
        "Geometric mean of detection accuracy and association accuracy, averaged over thresholds "
        "of similarity. Balances finding objects and keeping their identity.",
        lower_is_better=False,
    ),
    Measure(
        "recall",
        "recall",
        "Share of the true boxes that are matched, at the threshold of the best MOTA.",
        lower_is_better=False,
    ),
    Measure(
        "precision",
        "precision",
        "Share of the track boxes that are matched, at the threshold of the best MOTA.",
        lower_is_better=False,
    ),
    Measure("misses", "misses", "True boxes without a matched track.", lower_is_better=True),
    Measure(
        "false_positives",
        "false pos.",
        "Track boxes without a matched object.",
        lower_is_better=True,
    ),
    Measure(
        "id_switches",
        "switches",
        "Times that an object is matched with another identity than at its last match.",
        lower_is_better=True,
    ),
    Measure(
        "fragmentations",
        "fragments",
        "Times that a tracked object is lost and found again.",
        lower_is_better=True,
    ),
    Measure("truth_boxes", "true boxes", "Boxes of the truth that count: in range and seen."),
)

VELOCITY = (
    Measure(
        "mean_mps",
        "mean error",
        "Mean of |v of the track − v of its object| over the rows of the category. A track whose "
        "hull overlaps no object by half stands for something nobody labelled: its true velocity "
        "assumed zero (unlabelled tracks).",
        lower_is_better=True,
        unit="m/s",
    ),
    Measure(
        "worst_mean_mps",
        "worst 5 %",
        "Mean velocity error of the worst 5 % of the rows: how bad it gets when it is bad.",
        lower_is_better=True,
        unit="m/s",
    ),
)

FLOW = (
    Measure(
        "rmse_mps",
        "flow RMSE",
        "Root mean square error of the velocity of occupied cells whose truth is known; a cell "
        "that the source did not measure counts as standing still.",
        lower_is_better=True,
        unit="m/s",
    ),
    Measure(
        "median_mps",
        "median",
        "Median error of those velocities.",
        lower_is_better=True,
        unit="m/s",
    ),
    Measure(
        "within_1_mps",
        "within 1 m/s",
        "Share of the cells whose velocity is wrong by at most 1 m/s.",
        lower_is_better=False,
        digits=0,
        unit="%",
    ),
)

TIMING = Measure(
    "total_ms",
    "time a key frame",
    "Median wall time of flow, objects, velocity and tracker for one key frame, reading left out, "
    "one thread a scene. At 10 Hz there are 100 ms.",
    lower_is_better=True,
    digits=1,
    unit="ms",
)
INTERVAL = Measure(
    "interval",
    "95 % interval",
    "The scenes are drawn again with replacement, the same ones for both runs; the interval spans "
    "what the difference may be. Where it excludes zero the difference is called real. With few "
    "scenes it is wide: that is a finding about the data, not about the run.",
)
ORACLE = Measure(
    "oracle",
    "oracle",
    "A run that is given the true flow. It shows what a perfect source would reach and takes no "
    "part in the comparison of sources.",
)
GLOSSARY = (*TRACKING, *VELOCITY, *FLOW, TIMING, INTERVAL, ORACLE)

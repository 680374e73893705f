"""Name, unit, printed digits, better direction and definition of every metric of a run.

The one place for these: tables of the terminal, of files and of the report refer to it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MetricInfo:
    """How a metric is called, printed and ranked."""

    key: str
    """Its name in ``ClassScores.as_dict``, ``ErrorRow`` or ``FlowError``."""
    name: str
    definition: str
    lower_is_better: bool | None = None
    """None where neither direction is better."""
    digits: int = 3
    """Printed digits after the decimal point; 0 for counts."""
    unit: str = ""
    """"%" for a share in [0, 1] that is printed in per cent."""

    def text(self, value: float) -> str:
        """Return the printed value, a dash for NaN."""
        if value != value:
            return "–"
        if self.unit == "%":
            return f"{100 * value:.{self.digits}f} %"
        return f"{value:.{self.digits}f}".replace("-", "−")


TRACKING = (
    MetricInfo(
        "amota",
        "AMOTA",
        "Average multi-object tracking accuracy: the mean of MOTAR (MOTA corrected for the misses "
        "that the requested recall implies) over 40 recall levels, then over classes. The metric "
        "of the nuScenes leaderboard; it covers the whole range of score thresholds.",
        lower_is_better=False,
    ),
    MetricInfo(
        "amotp_m",
        "AMOTP",
        "Average multi-object tracking precision: the mean centre distance of matched boxes over "
        "the same recall levels. A level that is not reached counts as 2 m.",
        lower_is_better=True,
        unit="m",
    ),
    MetricInfo(
        "mota",
        "MOTA",
        "1 − (misses + false positives + identity switches) / true boxes, at the score threshold "
        "of each class that maximises it.",
        lower_is_better=False,
    ),
    MetricInfo(
        "motp_m",
        "MOTP",
        "Mean centre distance of matched boxes at that threshold (1 − IoU where boxes are matched "
        "by overlap).",
        lower_is_better=True,
        unit="m",
    ),
    MetricInfo(
        "idf1",
        "IDF1",
        "F1 score of boxes under the best one-to-one assignment of tracks to objects, which is "
        "fixed for a whole scene: rewards keeping one identity for long.",
        lower_is_better=False,
    ),
    MetricInfo(
        "hota",
        "HOTA",
        "Geometric mean of detection accuracy and association accuracy, averaged over similarity "
        "thresholds. Balances detecting objects and keeping their identity.",
        lower_is_better=False,
    ),
    MetricInfo(
        "recall",
        "recall",
        "Share of the true boxes that are matched, at the threshold of the best MOTA.",
        lower_is_better=False,
    ),
    MetricInfo(
        "precision",
        "precision",
        "Share of the track boxes that are matched, at the threshold of the best MOTA.",
        lower_is_better=False,
    ),
    MetricInfo(
        "misses", "misses", "True boxes without a matched track.", lower_is_better=True, digits=0
    ),
    MetricInfo(
        "false_positives",
        "false pos.",
        "Track boxes without a matched object.",
        lower_is_better=True,
        digits=0,
    ),
    MetricInfo(
        "id_switches",
        "switches",
        "Number of times that an object is matched with another identity than at its last match.",
        lower_is_better=True,
        digits=0,
    ),
    MetricInfo(
        "fragmentations",
        "fragments",
        "Number of times that a tracked object is lost and found again.",
        lower_is_better=True,
        digits=0,
    ),
    MetricInfo(
        "truth_boxes",
        "true boxes",
        "True boxes that are evaluated: in range and with LiDAR returns.",
        digits=0,
    ),
)

VELOCITY = (
    MetricInfo(
        "mean_mps",
        "mean error",
        "Mean of |v of the track − v of its object| over the track rows of the category. A track "
        "whose hull overlaps no labelled object by half is assumed static: its true velocity is "
        "taken as zero.",
        lower_is_better=True,
        unit="m/s",
    ),
    MetricInfo(
        "worst_mean_mps",
        "worst 5 %",
        "Mean velocity error of the worst 5 % of the track rows (tail mean).",
        lower_is_better=True,
        unit="m/s",
    ),
)

FLOW = (
    MetricInfo(
        "rmse_mps",
        "flow RMSE",
        "Root mean square error of the velocity of occupied cells with known truth; a cell that "
        "the source did not measure counts as zero velocity.",
        lower_is_better=True,
        unit="m/s",
    ),
    MetricInfo(
        "median_mps",
        "median",
        "Median error of those velocities.",
        lower_is_better=True,
        unit="m/s",
    ),
    MetricInfo(
        "within_1_mps",
        "within 1 m/s",
        "Share of the cells whose velocity error is at most 1 m/s.",
        lower_is_better=False,
        digits=0,
        unit="%",
    ),
)

PROTOCOLS = (
    MetricInfo(
        "motar",
        "MOTAR",
        "nuScenes: MOTA at one recall level, corrected for the misses that the level implies.",
        lower_is_better=False,
    ),
    MetricInfo(
        "samota",
        "sAMOTA",
        "KITTI by AB3DMOT: the mean over 40 recall levels of MOTA scaled to [0, 1].",
        lower_is_better=False,
    ),
    MetricInfo(
        "mostly_tracked",
        "MT, ML",
        "True tracks that are matched in at least 80 %, in less than 20 % of their frames.",
        digits=0,
    ),
    MetricInfo(
        "tid",
        "TID, LGD",
        "nuScenes: seconds until a true track is first matched; its longest gap in seconds.",
        lower_is_better=True,
        unit="s",
    ),
    MetricInfo(
        "det_a",
        "DetA",
        "Detection accuracy of HOTA: matches over matches, misses and false positives.",
        lower_is_better=False,
    ),
    MetricInfo(
        "ass_a",
        "AssA",
        "Association accuracy of HOTA: how much of both tracks of a match agrees, on average.",
        lower_is_better=False,
    ),
    MetricInfo("loc_a", "LocA", "Mean similarity of the matches of HOTA.", lower_is_better=False),
    MetricInfo(
        "argoverse2_amota",
        "AMOTA (Argoverse 2)",
        "Mean of MOTA, negative ones as 0, over ten score thresholds.",
        lower_is_better=False,
    ),
    MetricInfo(
        "waymo_mota",
        "MOTA (Waymo)",
        "MOTA at the best of 101 score cutoffs, with Waymo's rule of mismatches.",
        lower_is_better=False,
    ),
)
"""Of one protocol or a part of another metric; a run's tables do not have columns for them."""

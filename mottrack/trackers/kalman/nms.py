"""Non-maximum suppression of detections, before tracking."""

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.geometry.iou import bev_iou_of_pairs
from mottrack.trackers.association.candidates import candidate_pairs


def non_maximum_suppression(boxes: F64, score: F64, group: I64, iou: float) -> I64:
    """Rows (sorted) of the boxes that no better box of their group covers.

    boxes (N, 7) are x, y, z, l, w, h, yaw; score (N,); group (N,): only boxes of one group
    suppress each other. From the best score down (ties: the earlier row), a box goes if its BeV
    IoU with a box that stays is above `iou`.
    """
    order = np.argsort(-score, kind="stable")
    ranked = boxes[order]
    diagonal = np.hypot(ranked[:, 3], ranked[:, 4])
    reach = 0.5 * (diagonal + diagonal.max(initial=0.0))
    better, worse = candidate_pairs(ranked[:, :2], ranked[:, :2], reach, (group[order],) * 2)
    later = better < worse
    better, worse = better[later], worse[later]
    covered = bev_iou_of_pairs(ranked, ranked, (better, worse)) > iou
    alive = np.ones(len(order), bool)
    for winner, loser in zip(better[covered].tolist(), worse[covered].tolist(), strict=True):
        alive[loser] &= not alive[winner]
    return np.asarray(np.sort(order[alive]))

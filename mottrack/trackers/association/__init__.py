"""Who belongs to whom: gate, cost and assignment as pure functions of arrays.

Overlaps are in `association.overlap`, which needs numba, so they are not loaded here.
"""

from mottrack.trackers.association.assign import (
    ASSIGNMENTS,
    Assignment,
    greedy,
    hungarian,
    mutual_nearest,
)
from mottrack.trackers.association.candidates import candidate_pairs
from mottrack.trackers.association.cost import centre_distance_m, mahalanobis

__all__ = [
    "ASSIGNMENTS",
    "Assignment",
    "candidate_pairs",
    "centre_distance_m",
    "greedy",
    "hungarian",
    "mahalanobis",
    "mutual_nearest",
]

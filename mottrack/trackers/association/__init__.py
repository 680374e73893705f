"""Data association: candidate search, pair costs and assignment as pure functions of arrays."""

from mottrack.trackers.association.assign import (
    ASSIGNMENTS,
    Assignment,
    greedy,
    hungarian,
    mutual_nearest,
)
from mottrack.trackers.association.candidates import candidate_pairs
from mottrack.trackers.association.cost import OVERLAPS, centre_distance_m, overlap_cost

__all__ = [
    "ASSIGNMENTS",
    "OVERLAPS",
    "Assignment",
    "candidate_pairs",
    "centre_distance_m",
    "greedy",
    "hungarian",
    "mutual_nearest",
    "overlap_cost",
]

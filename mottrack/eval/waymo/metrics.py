"""MOTA by the rules of the Waymo Open Dataset.

Frame by frame a pair that was matched at the object's last match stays matched while it overlaps
enough; of the others the greatest total overlap is matched. A mismatch is a match with another
identity than the last one, and also a match of an identity whose last object is not in the frame:
that object loses it. Of the score cutoffs the one of the best MOTA counts; where no cutoff has a
MOTA above 0 the official code reports 0 throughout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval import arithmetic
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.pairs import BoxStream, Extended, Pairs, find_pairs, overlap
from mottrack.eval.waymo.boxes import LEVELS, PARTS, Part, Segment, SegmentBoxes, WaymoRules
from mottrack.geometry.iou import iou_3d

QUANTA = 1_000_000
"""The official matching knows an overlap in whole millionths."""


@dataclass(frozen=True, slots=True)
class WaymoCounts:
    """Counts of one pass; they add up over segments."""

    truth: int = 0
    """True boxes, without those that are harder than the level and were not found."""
    matches: int = 0
    misses: int = 0
    mismatches: int = 0
    false_positives: int = 0
    cost: float = 0.0
    """Sum of 1 - IoU of all matches."""


@dataclass(frozen=True, slots=True)
class WaymoMetrics:
    """One part at one level of difficulty, at the cutoff of the best MOTA."""

    mota: float = 0.0
    motp: float = 0.0
    """Mean of 1 - IoU."""
    miss: float = 0.0
    """Misses, mismatches and false positives are shares of the true boxes."""
    mismatch: float = 0.0
    false_positive: float = 0.0
    cutoff: float = 0.0
    truth: int = 0
    """True boxes at the lowest cutoff."""


class PartSequence(NamedTuple):
    """The boxes of one part of a segment, and their pairs."""

    pairs: Pairs
    score: F64
    """(P,)"""
    ignored: Mask
    """(P,)"""
    level: I64
    """(G,)"""


def part_sequence(segment: Segment, part: Part, rules: WaymoRules) -> PartSequence:
    """Return the pairs of one part that overlap enough to match."""
    truth, tracks = (b.select(part.holds(b)) for b in (segment.truth, segment.tracks))
    first, second = (BoxStream(b.frame, b.id) for b in (truth, tracks))
    measure = overlap(_single_iou, _extended(truth), _extended(tracks))
    pairs = find_pairs(first, second, segment.frames, measure)
    least = np.float32(rules.min_iou[part.kind - 1])
    near = pairs.similar(float(least))
    return PartSequence(near, tracks.score, tracks.ignored, truth.level)


def _single_iou(a: F64, b: F64) -> F64:
    # the official code keeps overlaps in single precision, and so its comparison with the least
    return iou_3d(a, b).astype(np.float32).astype(np.float64)


def _extended(boxes: SegmentBoxes) -> Extended:
    reach_m = np.hypot(boxes.box[:, 3], boxes.box[:, 4]) / 2
    x = boxes.box[:, 0]
    return Extended(boxes.box, np.column_stack([x - reach_m, x + reach_m]))


def count(sequence: PartSequence, cutoff: float) -> dict[int, WaymoCounts]:
    """Return the counts of a pass over one part of a segment, by level of difficulty."""
    chosen = sequence.score >= np.float32(cutoff)
    pairs = sequence.pairs.of_tracks(chosen)
    found = _associate(pairs)
    hit = found.match >= 0
    unmatched = np.ones(len(pairs.tracks), np.bool_)
    unmatched[found.match[hit]] = False
    extra = int(np.count_nonzero(unmatched & ~sequence.ignored[chosen]))
    counts = {}
    for level in LEVELS:
        misses = int(np.count_nonzero(~hit & (sequence.level <= level)))
        hits = int(np.count_nonzero(hit))
        counts[level] = WaymoCounts(
            hits + misses, hits, misses, found.mismatches, extra, found.cost
        )
    return counts


class _Associated(NamedTuple):
    match: I64
    """(G,) row of the matched track box, -1 for none."""
    mismatches: int
    cost: float


def _associate(pairs: Pairs) -> _Associated:
    """Match frame by frame; `holds` is each object's last identity, one to one."""
    match = np.full(len(pairs.truth), -1)
    holds: dict[int, int] = {}
    mismatches, cost = 0, 0.0
    for rows in pairs.by_frame(np.unique(pairs.frame)):
        objects = pairs.truth.id[rows.truth].tolist()
        names = pairs.tracks.id[rows.tracks].tolist()
        similarity = pairs.matrix(rows, pairs.similarity, 0.0)
        row, column = _match_frame(similarity, objects, names, holds)
        match[rows.truth.start + row] = rows.tracks.start + column
        cost += float((1.0 - similarity[row, column]).sum())
        new = {objects[i]: names[j] for i, j in zip(row.tolist(), column.tolist(), strict=True)}
        mismatches += _mismatches(new, holds, set(objects) | set(new))
        _remember(new, holds)
    return _Associated(match, mismatches, cost)


class _Matched(NamedTuple):
    row: I64
    column: I64


def _match_frame(
    similarity: F64, objects: list[int], names: list[int], holds: dict[int, int]
) -> _Matched:
    """Return the matches of a frame: kept ones, then the greatest total overlap."""
    place = {name: k for k, name in reversed(list(enumerate(names)))}
    kept = [
        (i, j)
        for i, name in enumerate(objects)
        if (j := place.get(holds.get(name, -1), -1)) >= 0 and similarity[i, j] > 0.0
    ]
    rows = np.setdiff1d(np.arange(len(objects)), [i for i, _ in kept])
    columns = np.setdiff1d(np.arange(len(names)), [j for _, j in kept])
    quantised = np.floor(similarity[rows[:, None], columns] * QUANTA)
    found = linear_sum_assignment(quantised, maximize=True)
    good = quantised[found.row, found.column] > 0.0
    row = [*(i for i, _ in kept), *rows[found.row[good]].tolist()]
    column = [*(j for _, j in kept), *columns[found.column[good]].tolist()]
    return _Matched(np.array(row, np.int64), np.array(column, np.int64))


def _mismatches(new: dict[int, int], holds: dict[int, int], there: set[int]) -> int:
    held_by = {name: o for o, name in holds.items()}
    count = 0
    for o, name in new.items():
        count += holds.get(o, name) != name
        before = held_by.get(name)
        count += before is not None and before not in there
    return count


def _remember(new: dict[int, int], holds: dict[int, int]) -> None:
    """Take the new matches over; an object whose identity went to another one has none."""
    held_by = {name: o for o, name in holds.items()}
    for name in new.values():
        before = held_by.get(name)
        if before is not None and before not in new:
            del holds[before]
    holds.update(new)


def evaluate(
    segments: Sequence[Segment], rules: WaymoRules | None = None
) -> dict[tuple[str, int], WaymoMetrics]:
    """Return the metrics by name of a part and level of difficulty."""
    rules = rules or WaymoRules()
    found: dict[tuple[str, int], WaymoMetrics] = {}
    for part in PARTS:
        sequences = [part_sequence(segment, part, rules) for segment in segments]
        passes = [_pass(sequences, cutoff) for cutoff in _distinct(sequences, rules.cutoffs)]
        for level in LEVELS:
            found[part.name, level] = best({c: counts[level] for c, counts in passes})
    return found


def _distinct(sequences: Sequence[PartSequence], cutoffs: Sequence[float]) -> list[float]:
    """Leave out the cutoffs that choose the same boxes as the one before: the lower one counts."""
    scores = np.sort(np.concatenate([s.score for s in sequences]))
    chosen = np.searchsorted(scores, np.asarray(cutoffs, np.float32).astype(np.float64))
    return [c for k, c in enumerate(cutoffs) if k == 0 or chosen[k] != chosen[k - 1]]


def _pass(sequences: Sequence[PartSequence], cutoff: float) -> tuple[float, dict[int, WaymoCounts]]:
    counted = [count(sequence, cutoff) for sequence in sequences]
    return cutoff, {
        level: arithmetic.total((c[level] for c in counted), WaymoCounts()) for level in LEVELS
    }


def best(passes: Mapping[float, WaymoCounts]) -> WaymoMetrics:
    """Return the metrics at the cutoff of the best MOTA, the first of equal ones.

    >>> low, high = WaymoCounts(8, 6, 2, 1, 3, 1.2), WaymoCounts(8, 5, 3, 0, 0, 0.75)
    >>> found = best({0.0: low, 0.5: high})
    >>> found.mota, found.motp, found.miss, found.cutoff
    (0.625, 0.15, 0.375, 0.5)
    """
    found = WaymoMetrics(truth=next(iter(passes.values())).truth)
    for cutoff, c in passes.items():
        if not c.truth:
            continue
        # in single precision as the official code, whose rounding decides between equal MOTAs
        errors = (c.misses, c.false_positives, c.mismatches)
        miss, extra, mismatch = (np.float32(n) / np.float32(c.truth) for n in errors)
        mota = np.float32(1.0 - float(miss + extra + mismatch))
        if mota > found.mota:
            motp = c.cost / c.matches if c.matches else 0.0
            shares = (float(miss), float(mismatch), float(extra))
            found = WaymoMetrics(float(mota), motp, *shares, cutoff, found.truth)
    return found

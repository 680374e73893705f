"""Candidate pairs, and one pass over a scene at one score threshold, compiled.

The rules are those of motmetrics' accumulator as nuScenes uses it: the last match of an object is
kept after a gap of any length, then as many matches as possible with the least total distance.
Nothing is stored per event; a pass keeps a few numbers per object.

Rows are records, so that a pass has few arrays, and the functions are few, hence longer than
elsewhere: both shorten the compilation on the first use after an installation.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.eval.arithmetic import MOSTLY_LOST, MOSTLY_TRACKED
from mottrack.eval.nuscenes.assignment import Solver, solve
from mottrack.eval.nuscenes.products import FIRST_FUSED, LAST_FUSED, Products, fma

MISS, MATCH, SWITCH = 0, 1, 2
TP, IDS, FN, FP, FRAMES, FRAG, MT, ML, TRACKED, WAIT, GAP = range(11)
COUNT_NAMES = (
    "tp", "ids", "fn", "fp", "frames", "frag", "mt", "ml", "tracked", "wait", "gap",
)  # fmt: skip
"""Columns of the counts of a pass: `wait` is frames before the first hit, `gap` the longest gap of
each true track that was hit, both summed over those `tracked` tracks."""

SCENE = np.dtype([("frame", "i8"), ("object", "i8")])
FRAME = np.dtype([("truth", "i8"), ("track", "i8")])
TRUTH = np.dtype(
    {
        "names": ["x", "y", "object", "pair", "match", "distance", "carried", "event"],
        "formats": ["f8", "f8", "i8", "i8", "i8", "f8", "i8", "i8"],
    }
)
TRACK = np.dtype(
    {
        "names": ["x", "y", "id", "score", "same_before", "rank", "candidate"],
        "formats": ["f8", "f8", "i8", "f8", "i8", "i8", "i8"],
    }
)
PAIR = np.dtype([("track", "i8"), ("wide", "f8"), ("thin", "f8"), ("single", "f8")])
WIDE, THIN, SINGLE = range(3)
"""Shapes of a frame: more boxes than one on both sides, on one side, on none."""
OBJECT = np.dtype(
    [("length", "i8"), ("last", "i8"), ("hits", "i8"), ("run", "i8"), ("longest", "i8")]
)
TAKEN = -1
"""Rank of a predicted box that is below the threshold or matched already."""


class Scenes(NamedTuple):
    """Boxes of one class in all scenes, sorted by frame, and their candidate pairs.

    Every table but the last two ends with a row that holds the ends of the next one.
    """

    scene: NDArray[Any]
    """(S + 1,) of SCENE: first frame and first true track of each scene."""
    frame: NDArray[Any]
    """(frames + 1,) of FRAME: first true and first predicted box of each frame."""
    truth: NDArray[Any]
    """(G + 1,) of TRUTH: position, true track, first pair; then what a pass found: the matched
    predicted box (-1: none), its distance, whether carried over, MISS, MATCH or SWITCH."""
    track: NDArray[Any]
    """(P + 1,) of TRACK: position, predicted track (from 1), score, the box before with the same
    id in the frame (-1: none); then, in a pass, its rank among the boxes of its frame above the
    threshold, or TAKEN, and whether it is a candidate of a true box."""
    pair: NDArray[Any]
    """(pairs,) of PAIR: predicted box and distance in metres, infinite beyond the gate, as it
    is rounded in a frame of each shape."""
    object: NDArray[Any]
    """(objects,) of OBJECT: boxes of each true track; then, in a pass, its last match (0: none),
    hits, misses running now, longest run of misses. All zero between passes."""


@compiled(no_cfunc_wrapper=True)
def find_candidates(scenes: Scenes, gate: float, products: Products) -> int:
    """List the pairs of each frame nearer than the gate, as far as there is room in `pair`.

    Return their number, so that a first call with no room counts them. The official distance is
    sqrt(|g|^2 + |p|^2 - 2 g.p) by a matrix product, whose rounding depends on its shape and on the
    processor (`products`). At 1e3 m from the origin this moves a distance by up to 1e-5 m.
    """
    count = 0
    for f in range(len(scenes.frame) - 1):
        now, end = scenes.frame[f], scenes.frame[f + 1]
        for g in range(now.truth, end.truth + 1):
            t = scenes.truth[g]
            t.pair = count
            if g == end.truth:
                break
            x, y = t.x, t.y
            for p in range(now.track, end.track):
                a, b = scenes.track[p].x, scenes.track[p].y
                # a cheap first test, wider than the gate by more than the rounding of the distance
                if abs(a - x) > gate + 0.1 or abs(b - y) > gate + 0.1:
                    continue
                own, other = x * x + y * y, a * a + b * b
                last, first, plain = fma(y, b, x * a), fma(x, a, y * b), x * a + y * b
                way = products.wide
                dot = last if way == LAST_FUSED else first if way == FIRST_FUSED else plain
                wide = (-2.0 * dot + own) + other
                way = products.thin
                dot = last if way == LAST_FUSED else first if way == FIRST_FUSED else plain
                thin = (-2.0 * dot + own) + other
                way = products.single
                dot = last if way == LAST_FUSED else first if way == FIRST_FUSED else plain
                single = (-2.0 * dot + own) + other
                wide = np.sqrt(wide) if wide > 0.0 else 0.0
                thin = np.sqrt(thin) if thin > 0.0 else 0.0
                single = np.sqrt(single) if single > 0.0 else 0.0
                if wide >= gate and thin >= gate and single >= gate:
                    continue
                if count < len(scenes.pair):
                    pair = scenes.pair[count]
                    pair.track = p
                    pair.wide = wide if wide < gate else np.inf
                    pair.thin = thin if thin < gate else np.inf
                    pair.single = single if single < gate else np.inf
                count += 1
    return count


class Passes(NamedTuple):
    """J passes over one scene each, and what they count."""

    scene: I64
    """(J,)"""
    threshold: F64
    """(J,) least score of a predicted box that takes part."""
    counts: I64
    """(J, COUNT_NAMES) to be filled."""
    distance_m: F64
    """(J,) sum of the distances of all matches, to be filled."""


@compiled(no_cfunc_wrapper=True)
def count_passes(scenes: Scenes, solver: Solver, passes: Passes) -> None:  # noqa: C901
    """Run all passes; leave the events of the last pass over each scene in `scenes.truth`."""
    for job in range(len(passes.scene)):
        scene, threshold = passes.scene[job], passes.threshold[job]
        count = passes.counts[job]
        for f in range(scenes.scene[scene].frame, scenes.scene[scene + 1].frame):
            now, end = scenes.frame[f], scenes.frame[f + 1]
            boxes = end.truth - now.truth
            active = np.int64(0)
            for p in range(now.track, end.track):
                track = scenes.track[p]
                above = track.score >= threshold
                track.rank = active if above else TAKEN
                track.candidate = 0
                if above:
                    active += 1
            if boxes + active == 0:
                continue
            shape = WIDE if boxes != 1 and active != 1 else THIN if boxes != active else SINGLE
            furthest = _match_frame(scenes, f, shape)
            if furthest >= 0.0:
                _assign(scenes, solver, f, active, furthest)
            passes.distance_m[job] += _record(scenes, f, count)
            count[FRAMES] += 1
            count[FP] += active
        count[FP] -= count[TP] + count[IDS]
        for o in range(scenes.scene[scene].object, scenes.scene[scene + 1].object):
            track = scenes.object[o]
            share = track.hits / track.length
            count[MT] += share >= MOSTLY_TRACKED
            count[ML] += share < MOSTLY_LOST
            if track.hits > 0:
                count[TRACKED] += 1
                count[GAP] += track.run if track.run > track.longest else track.longest
            track.last = track.hits = track.run = track.longest = 0


@compiled(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _match_frame(scenes: Scenes, f: int, shape: int) -> float:  # noqa: C901
    """Keep last matches, in the order of truth; then match boxes with one candidate each.

    Of several boxes with the remembered id only the first free one is looked at; if that is too
    far, nothing is carried over. Return the furthest candidate distance if some box has two
    candidates, so that an assignment is needed, else -1.
    """
    now, end = scenes.frame[f], scenes.frame[f + 1]
    for g in range(now.truth, end.truth):
        t = scenes.truth[g]
        t.match = -1
        t.carried = 0
        last = scenes.object[t.object].last
        for e in range(t.pair, scenes.truth[g + 1].pair):
            pair = scenes.pair[e]
            track = scenes.track[pair.track]
            if last == 0 or track.id != last or track.rank == TAKEN:
                continue
            before = track.same_before
            while before >= 0 and scenes.track[before].rank == TAKEN:
                before = scenes.track[before].same_before
            d = pair.wide if shape == WIDE else pair.thin if shape == THIN else pair.single
            if before < 0 and d < np.inf:
                t.match = pair.track
                t.distance = d
                t.carried = 1
                track.rank = TAKEN
            break
    conflict, furthest = False, 0.0
    for g in range(now.truth, end.truth):
        t = scenes.truth[g]
        if t.carried:
            continue
        for e in range(t.pair, scenes.truth[g + 1].pair):
            pair = scenes.pair[e]
            track = scenes.track[pair.track]
            d = pair.wide if shape == WIDE else pair.thin if shape == THIN else pair.single
            if track.rank != TAKEN and d < np.inf:
                conflict = conflict or t.match >= 0 or track.candidate > 0
                furthest = d if d > furthest else furthest
                t.match = pair.track
                t.distance = d
                track.candidate = 1
    return furthest if conflict else -1.0


@compiled(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _assign(  # noqa: C901
    scenes: Scenes, solver: Solver, f: int, active: np.int64, furthest: float
) -> None:
    """Assign most matches first, least distance second, the whole frame as the official code.

    A forbidden pair costs more than all allowed ones together.
    """
    first, end = scenes.frame[f].truth, scenes.frame[f + 1].truth
    boxes = end - first
    shape = WIDE if boxes != 1 and active != 1 else THIN if boxes != active else SINGLE
    rows, columns = (active, boxes) if active < boxes else (boxes, active)
    forbidden = 2 * rows * (furthest + 1.0) + 1.0
    for i in range(rows):
        for j in range(columns):
            solver.cost[i, j] = forbidden
    for decided in range(2):
        for g in range(first, end):
            t = scenes.truth[g]
            if t.carried:
                continue
            i = g - first
            place = solver.column[i].row if active < boxes else solver.row[i].column
            t.match = -1
            for e in range(t.pair, scenes.truth[g + 1].pair):
                pair = scenes.pair[e]
                rank = scenes.track[pair.track].rank
                d = pair.wide if shape == WIDE else pair.thin if shape == THIN else pair.single
                if rank == TAKEN or d == np.inf:
                    continue
                if decided and rank == place:
                    t.match = pair.track
                    t.distance = d
                elif not decided and active < boxes:
                    solver.cost[rank, i] = d
                elif not decided:
                    solver.cost[i, rank] = d
        if not decided:
            solve(solver, rows, columns)


@compiled(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _record(scenes: Scenes, f: int, count: I64) -> float:
    """Count a matched frame, update its objects and return the distances of the matches."""
    metres = 0.0
    for g in range(scenes.frame[f].truth, scenes.frame[f + 1].truth):
        t = scenes.truth[g]
        o = scenes.object[t.object]
        if t.match < 0:
            t.event = MISS
            count[FN] += 1
            o.run += 1
            continue
        metres += t.distance
        now = scenes.track[t.match].id
        switched = t.carried == 0 and o.last > 0 and o.last != now
        t.event = SWITCH if switched else MATCH
        count[IDS if switched else TP] += 1
        if o.hits == 0:
            count[WAIT] += o.run
        elif o.run > 0:
            count[FRAG] += 1
        if o.run > o.longest:
            o.longest = o.run
        o.last = now
        o.hits += 1
        o.run = 0
    return metres

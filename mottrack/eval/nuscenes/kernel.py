"""The compiled part: candidate pairs, and one pass over a scene at one score threshold.

The rules are those of motmetrics' accumulator as nuScenes uses it: the last match of an object is
kept after a gap of any length, then as many matches as possible with the least total distance.
Nothing is stored per event; a pass keeps a few numbers per object.

Rows are records, so that a pass has few arrays: that halves both its time and its compilation.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from mottrack.eval.nuscenes.assignment import Solver, solve

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
MISS, MATCH, SWITCH = 0, 1, 2
TP, IDS, FN, FP, FRAMES, FRAG, MT, ML, TRACKED, WAIT, GAP = range(11)
COUNTS = 11
"""Columns of the counts of a pass: WAIT is frames before the first hit, GAP the longest gap."""

SCENE = np.dtype([("frame", "i8"), ("object", "i8")])
FRAME = np.dtype([("truth", "i8"), ("track", "i8")])
TRUTH = np.dtype(
    [("x", "f8"), ("y", "f8"), ("object", "i8"), ("pair", "i8")]
    + [("match", "i8"), ("distance", "f8"), ("carried", "i8"), ("event", "i8")]
)
TRACK = np.dtype(
    [("x", "f8"), ("y", "f8"), ("id", "i8"), ("score", "f8"), ("same_before", "i8")]
    + [("rank", "i8"), ("free", "i8"), ("rivals", "i8"), ("active", "i8")]
)
PAIR = np.dtype([("track", "i8"), ("wide", "f8"), ("thin", "f8")])
OBJECT = np.dtype(
    [("length", "i8"), ("last", "i8"), ("hits", "i8"), ("run", "i8"), ("longest", "i8")]
)


class Scenes(NamedTuple):
    """Boxes of one class in all scenes, sorted by frame, and their candidate pairs.

    Every table ends with a row that holds the ends. "First" rows are those of the next table.
    """

    scene: NDArray[Any]
    """(S + 1,) of SCENE: first frame and first true track of each scene."""
    frame: NDArray[Any]
    """(frames + 1,) of FRAME: first true and first predicted box of each frame."""
    truth: NDArray[Any]
    """(G + 1,) of TRUTH: position, true track, first pair; then what a pass found: the matched
    predicted box (-1: none), its distance, whether carried over, MISS, MATCH or SWITCH."""
    track: NDArray[Any]
    """(P + 1,) of TRACK: position, predicted track, score, the box before with the same id in
    the frame (-1: none); then, in a pass, its rank among the boxes of its frame above the
    threshold (-1: below), whether it is still free, and how many true boxes want it. `active`
    lists, from the first row of the frame on, the boxes above the threshold."""
    pair: NDArray[Any]
    """(pairs,) of PAIR: predicted box and distance in metres, infinite beyond the gate, as a
    matrix product rounds it and as it is rounded where one side has one box only."""
    object: NDArray[Any]
    """(objects,) of OBJECT: boxes of each true track; then, in a pass, its last match, hits,
    misses running now, longest run of misses."""


@intrinsic  # type: ignore[untyped-decorator]
def fma(_context: Any, a: Any, _b: Any, _c: Any) -> Any:
    """a * b + c, rounded once."""
    signature = types.float64(types.float64, types.float64, types.float64)

    def build(_target: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return signature, build


@numba.njit(cache=True)
def find_candidates(scenes: Scenes, gate: float) -> int:
    """Lists the pairs of each frame nearer than the gate, as far as there is room in `pair`.

    Returns their number, so that a first call with no room counts them. The official distance is
    sqrt(|g|^2 + |p|^2 - 2 g.p) by a matrix product, whose rounding depends on its shape: with one
    box on exactly one side the terms of g.p are added in the other order. At 1e3 m from the
    origin this moves a distance by up to 1e-5 m.
    """
    frame, truth, track, pair = scenes.frame, scenes.truth, scenes.track, scenes.pair
    count = 0
    for f in range(len(frame) - 1):
        for g in range(frame[f].truth, frame[f + 1].truth):
            truth[g].pair = count
            x, y = truth[g].x, truth[g].y
            for p in range(frame[f].track, frame[f + 1].track):
                a, b = track[p].x, track[p].y
                if abs(a - x) > gate + 0.1 or abs(b - y) > gate + 0.1:
                    continue
                own, other = x * x + y * y, a * a + b * b
                wide = np.sqrt(max((-2.0 * fma(y, b, x * a) + own) + other, 0.0))
                thin = np.sqrt(max((-2.0 * fma(x, a, y * b) + own) + other, 0.0))
                if wide >= gate and thin >= gate:
                    continue
                if count < len(pair):
                    pair[count].track = p
                    pair[count].wide = wide if wide < gate else np.inf
                    pair[count].thin = thin if thin < gate else np.inf
                count += 1
    truth[len(truth) - 1].pair = count
    return count


@numba.njit(cache=True)
def count_passes(
    scenes: Scenes, solver: Solver, passes: tuple[I64, F64], counts: I64, distance: F64
) -> None:
    """Runs one pass for each of J (scene, threshold).

    Fills counts (J, COUNTS) and the sum of distances (J,); leaves the events of the last pass over
    each scene in `scenes.truth`.
    """
    scene_of, threshold = passes
    scene, frame = scenes.scene, scenes.frame
    for job in range(len(scene_of)):
        now = scene_of[job]
        _open(scenes, now)
        for f in range(scene[now].frame, scene[now + 1].frame):
            active = _activate(scenes, f, threshold[job])
            boxes = frame[f + 1].truth - frame[f].truth
            if boxes + active == 0:
                continue
            counts[job, FRAMES] += 1
            if boxes > 0 and active > 0:
                thin = (boxes == 1) != (active == 1)
                _carry_over(scenes, f, thin)
                if _has_conflict(scenes, f, thin):
                    _assign(scenes, solver, f, active, thin)
                else:
                    _match_rest(scenes, f, thin)
            hits, metres = _record(scenes, f, counts[job])
            distance[job] += metres
            counts[job, FP] += active - hits
        _close(scenes, now, counts[job])


@numba.njit(cache=True)
def _open(scenes: Scenes, now: int) -> None:
    for o in range(scenes.scene[now].object, scenes.scene[now + 1].object):
        scenes.object[o].last = -1
        scenes.object[o].hits = 0
        scenes.object[o].run = 0
        scenes.object[o].longest = 0


@numba.njit(cache=True)
def _activate(scenes: Scenes, f: int, threshold: float) -> int:
    """Lists the predicted boxes of a frame that reach the threshold; returns how many."""
    frame, truth, track = scenes.frame, scenes.truth, scenes.track
    for g in range(frame[f].truth, frame[f + 1].truth):
        truth[g].match = -1
    first = frame[f].track
    active = 0
    for p in range(first, frame[f + 1].track):
        above = track[p].score >= threshold
        track[p].free = 1 if above else 0
        track[p].rank = active if above else -1
        track[p].rivals = 0
        if above:
            track[first + active].active = p
            active += 1
    return active


@numba.njit(cache=True)
def _carry_over(scenes: Scenes, f: int, thin: bool) -> None:
    """Keeps last matches, in the order of truth.

    Of several boxes with the remembered id only the first free one is looked at; if that is too
    far, nothing is carried over.
    """
    truth, track, pair = scenes.truth, scenes.track, scenes.pair
    for g in range(scenes.frame[f].truth, scenes.frame[f + 1].truth):
        last = scenes.object[truth[g].object].last
        if last < 0:
            continue
        for e in range(truth[g].pair, truth[g + 1].pair):
            p = pair[e].track
            if track[p].id != last or not track[p].free:
                continue
            before = track[p].same_before
            while before >= 0 and not track[before].free:
                before = track[before].same_before
            d = pair[e].thin if thin else pair[e].wide
            if before < 0 and d < np.inf:
                truth[g].match = p
                truth[g].distance = d
                truth[g].carried = 1
                track[p].free = 0
            break


@numba.njit(cache=True)
def _has_conflict(scenes: Scenes, f: int, thin: bool) -> bool:
    """Whether a box that is still free has two free candidates."""
    truth, track, pair = scenes.truth, scenes.track, scenes.pair
    for g in range(scenes.frame[f].truth, scenes.frame[f + 1].truth):
        if truth[g].match >= 0:
            continue
        own = 0
        for e in range(truth[g].pair, truth[g + 1].pair):
            p = pair[e].track
            if track[p].free and (pair[e].thin if thin else pair[e].wide) < np.inf:
                own += 1
                track[p].rivals += 1
                if own > 1 or track[p].rivals > 1:
                    return True
    return False


@numba.njit(cache=True)
def _match_rest(scenes: Scenes, f: int, thin: bool) -> None:
    """Matches what is left where no box has two candidates."""
    truth, track, pair = scenes.truth, scenes.track, scenes.pair
    for g in range(scenes.frame[f].truth, scenes.frame[f + 1].truth):
        if truth[g].match >= 0:
            continue
        for e in range(truth[g].pair, truth[g + 1].pair):
            p = pair[e].track
            d = pair[e].thin if thin else pair[e].wide
            if track[p].free and d < np.inf:
                truth[g].match = p
                truth[g].distance = d
                truth[g].carried = 0
                track[p].free = 0
                break


@numba.njit(cache=True)
def _assign(scenes: Scenes, solver: Solver, f: int, active: int, thin: bool) -> None:
    """Most matches first, least distance second, on the whole frame as the official code does.

    A forbidden pair costs more than all allowed ones together.
    """
    truth, track = scenes.truth, scenes.track
    first, boxes = scenes.frame[f].truth, scenes.frame[f + 1].truth - scenes.frame[f].truth
    rows, columns = min(boxes, active), max(boxes, active)
    turned = active < boxes
    forbidden = _fill_costs(scenes, solver, f, active, thin)
    solve(solver, rows, columns)
    for row in range(rows):
        column = solver.row[row].column
        d = solver.cost[row, column]
        if d >= forbidden:
            continue
        g = first + (column if turned else row)
        p = track[scenes.frame[f].track + (row if turned else column)].active
        truth[g].match = p
        truth[g].distance = d
        truth[g].carried = 0
        track[p].free = 0


@numba.njit(cache=True)
def _fill_costs(scenes: Scenes, solver: Solver, f: int, active: int, thin: bool) -> float:
    """Costs of the free pairs of a frame, the smaller side along the rows; returns the forbidden
    cost, which all other pairs get.
    """
    truth, track, pair = scenes.truth, scenes.track, scenes.pair
    first, end = scenes.frame[f].truth, scenes.frame[f + 1].truth
    furthest = 0.0
    for g in range(first, end):
        for e in range(truth[g].pair, truth[g + 1].pair):
            d = pair[e].thin if thin else pair[e].wide
            if truth[g].match < 0 and track[pair[e].track].free and d < np.inf:
                furthest = max(furthest, d)
    rows, columns = min(end - first, active), max(end - first, active)
    forbidden = 2 * rows * (furthest + 1.0) + 1.0
    for i in range(rows):
        for j in range(columns):
            solver.cost[i, j] = forbidden
    for g in range(first, end):
        for e in range(truth[g].pair, truth[g + 1].pair):
            p = pair[e].track
            d = pair[e].thin if thin else pair[e].wide
            if truth[g].match < 0 and track[p].free and d < np.inf:
                if active < end - first:
                    solver.cost[track[p].rank, g - first] = d
                else:
                    solver.cost[g - first, track[p].rank] = d
    return forbidden


@numba.njit(cache=True)
def _record(scenes: Scenes, f: int, count: I64) -> tuple[int, float]:
    """Counts a matched frame and updates its objects; returns hits and their distances."""
    truth, objects = scenes.truth, scenes.object
    hits = 0
    metres = 0.0
    for g in range(scenes.frame[f].truth, scenes.frame[f + 1].truth):
        o = truth[g].object
        if truth[g].match < 0:
            truth[g].event = MISS
            count[FN] += 1
            objects[o].run += 1
            continue
        hits += 1
        metres += truth[g].distance
        last, now = objects[o].last, scenes.track[truth[g].match].id
        switched = not truth[g].carried and last >= 0 and last != now
        truth[g].event = SWITCH if switched else MATCH
        count[IDS if switched else TP] += 1
        if objects[o].hits == 0:
            count[WAIT] += objects[o].run
        elif objects[o].run > 0:
            count[FRAG] += 1
        objects[o].last = now
        objects[o].hits += 1
        objects[o].longest = max(objects[o].longest, objects[o].run)
        objects[o].run = 0
    return hits, metres


@numba.njit(cache=True)
def _close(scenes: Scenes, now: int, count: I64) -> None:
    """Adds the figures that are per true track at the end of a scene."""
    for o in range(scenes.scene[now].object, scenes.scene[now + 1].object):
        hits = scenes.object[o].hits
        share = hits / scenes.object[o].length
        if share >= 0.8:
            count[MT] += 1
        if share < 0.2:
            count[ML] += 1
        if hits > 0:
            count[TRACKED] += 1
            count[GAP] += max(scenes.object[o].longest, scenes.object[o].run)

"""The compiled part: candidate pairs, and one pass over a scene at one score threshold.

The rules are those of motmetrics' accumulator as nuScenes uses it (docs of `mottrack.eval.nuscenes`):
carry-over of the last match after a gap of any length, then as many matches as possible with the
least total distance. Nothing is stored per event; a pass keeps a few numbers per object.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from mottrack.eval.nuscenes.assignment import Solver, make_solver, solve

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
MISS, MATCH, SWITCH = 0, 1, 2
# columns of the integer counts of a pass
TP, IDS, FN, FP, FRAMES, FRAG, MT, ML, TRACKED, WAIT, GAP = range(11)
COUNTS = 11
# rows of the state kept per object during a pass
LAST, HITS, RUN, LONGEST = range(4)


class Scenes(NamedTuple):
    """Boxes of one class in all scenes, sorted by frame, and their candidate pairs."""

    frame_edges: I64
    """(S + 1,) first frame of each scene, and the end; frames are counted through all scenes."""
    truth_edges: I64
    """(frames + 1,) first true box of each frame."""
    track_edges: I64
    """(frames + 1,) first predicted box of each frame."""
    object_edges: I64
    """(S + 1,) first true track of each scene; true tracks are numbered scene by scene."""
    truth_object: I64
    """(G,) true track of each true box."""
    length: I64
    """(objects,) boxes of each true track."""
    track_id: I64
    """(P,) predicted track of each predicted box."""
    same_before: I64
    """(P,) the box before with the same id in the same frame, -1 for none."""
    score: F64
    """(P,) score of each predicted box."""
    pair_edges: I64
    """(G + 1,) first candidate pair of each true box."""
    pair_track: I64
    """(pairs,) predicted box."""
    pair_distance: F64
    """(pairs, 2) metres, as rounded in a matrix product, and where one side has one box only."""


class Work(NamedTuple):
    """Working memory of a pass."""

    state: I64
    """(4, objects) last match, hits, misses running now, longest run of misses."""
    active: I64
    """Predicted boxes of the frame above the threshold."""
    column: I64
    """Per predicted box of the frame its place in `active`, -1 below the threshold."""
    used: NDArray[np.bool_]
    rivals: I64
    match: I64
    """Per true box of the frame the matched predicted box, -1 for none."""
    distance: F64
    carried: NDArray[np.bool_]
    solver: Solver


def make_work(scenes: Scenes) -> Work:
    """Memory large enough for every frame."""
    truth = int(np.diff(scenes.truth_edges).max(initial=0)) + 1
    tracks = int(np.diff(scenes.track_edges).max(initial=0)) + 1
    return Work(
        state=np.empty((4, len(scenes.length)), np.int64),
        active=np.empty(tracks, np.int64),
        column=np.empty(tracks, np.int64),
        used=np.empty(tracks, np.bool_),
        rivals=np.empty(tracks, np.int64),
        match=np.empty(truth, np.int64),
        distance=np.empty(truth),
        carried=np.empty(truth, np.bool_),
        solver=make_solver(max(truth, tracks)),
    )


@intrinsic  # type: ignore[untyped-decorator]
def fma(_context: Any, a: Any, _b: Any, _c: Any) -> Any:
    """a * b + c, rounded once."""
    signature = types.float64(types.float64, types.float64, types.float64)

    def build(_target: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return signature, build


@numba.njit(cache=True)
def candidate_pairs(
    edges: tuple[I64, I64], truth_xy: F64, track_xy: F64, gate: float, out: tuple[I64, I64, F64]
) -> int:
    """Pairs of the same frame nearer than the gate; returns their number.

    `edges` are those of truth and tracks. `out` (pair_edges, pair_track, pair_distance) is filled
    as far as there is room, so a first call with no room only counts.

    The official distance is sqrt(|g|^2 + |p|^2 - 2 g.p) by a matrix product, whose rounding
    depends on the product's shape: with one box on exactly one side the terms of g.p are added
    in the other order. At 1e3 m from the origin this moves a distance by up to 1e-5 m.
    """
    truth_edges, track_edges = edges
    pair_edges, pair_track, pair_distance = out
    count = 0
    pair_edges[0] = 0
    for f in range(len(truth_edges) - 1):
        for g in range(truth_edges[f], truth_edges[f + 1]):
            x, y = truth_xy[g, 0], truth_xy[g, 1]
            for p in range(track_edges[f], track_edges[f + 1]):
                a, b = track_xy[p, 0], track_xy[p, 1]
                if abs(a - x) > gate + 0.1 or abs(b - y) > gate + 0.1:
                    continue
                squares = x * x + y * y
                squares_p = a * a + b * b
                wide = (-2.0 * fma(y, b, x * a) + squares) + squares_p
                thin = (-2.0 * fma(x, a, y * b) + squares) + squares_p
                wide = np.sqrt(max(wide, 0.0))
                thin = np.sqrt(max(thin, 0.0))
                if wide >= gate and thin >= gate:
                    continue
                if count < len(pair_track):
                    pair_track[count] = p
                    pair_distance[count, 0] = wide if wide < gate else np.inf
                    pair_distance[count, 1] = thin if thin < gate else np.inf
                count += 1
            pair_edges[g + 1] = count
    return count


@numba.njit(cache=True)
def count_passes(
    scenes: Scenes, work: Work, passes: tuple[I64, F64], counts: I64, distance: F64, event: I64
) -> None:
    """Runs one pass for each of J (scene, threshold).

    Fills counts (J, COUNTS) and the sum of distances (J,). `event` (2, G) gets MISS, MATCH or
    SWITCH and the matched box (-1) of each true box, from the last pass over its scene.
    """
    scene_of, threshold = passes
    for job in range(len(scene_of)):
        scene = scene_of[job]
        first, end = scenes.object_edges[scene], scenes.object_edges[scene + 1]
        for o in range(first, end):
            work.state[LAST, o] = -1
            work.state[HITS, o] = 0
            work.state[RUN, o] = 0
            work.state[LONGEST, o] = 0
        count = counts[job]
        for f in range(scenes.frame_edges[scene], scenes.frame_edges[scene + 1]):
            active = _activate(scenes, work, f, threshold[job])
            truth = scenes.truth_edges[f + 1] - scenes.truth_edges[f]
            if truth + active == 0:
                continue
            count[FRAMES] += 1
            for i in range(truth):
                work.match[i] = -1
            if truth > 0 and active > 0:
                thin = 1 if (truth == 1) != (active == 1) else 0
                _carry_over(scenes, work, f, thin)
                _match_rest(scenes, work, f, active, thin)
            hits = _record(scenes, work, f, count, event)
            for i in range(truth):
                if work.match[i] >= 0:
                    distance[job] += work.distance[i]
            count[FP] += active - hits
        _close(scenes, work, scene, count)


@numba.njit(cache=True)
def _activate(scenes: Scenes, work: Work, f: int, threshold: float) -> int:
    """Lists the predicted boxes of a frame that reach the threshold; returns how many."""
    first = scenes.track_edges[f]
    active = 0
    for p in range(first, scenes.track_edges[f + 1]):
        work.used[p - first] = False
        work.rivals[p - first] = 0
        work.column[p - first] = -1
        if scenes.score[p] >= threshold:
            work.column[p - first] = active
            work.active[active] = p
            active += 1
    return active


@numba.njit(cache=True)
def _is_free(scenes: Scenes, work: Work, f: int, p: int) -> bool:
    at = p - scenes.track_edges[f]
    return bool(work.column[at] >= 0 and not work.used[at])


@numba.njit(cache=True)
def _take(scenes: Scenes, work: Work, f: int, i: int, p: int, d: float, carried: bool) -> None:
    work.match[i] = p
    work.distance[i] = d
    work.carried[i] = carried
    work.used[p - scenes.track_edges[f]] = True


@numba.njit(cache=True)
def _carry_over(scenes: Scenes, work: Work, f: int, thin: int) -> None:
    """Keeps last matches, in the order of truth.

    Of several boxes with the remembered id only the first free one is looked at; if that is too
    far, nothing is carried over.
    """
    first = scenes.truth_edges[f]
    for g in range(first, scenes.truth_edges[f + 1]):
        last = work.state[LAST, scenes.truth_object[g]]
        if last < 0:
            continue
        for e in range(scenes.pair_edges[g], scenes.pair_edges[g + 1]):
            p = scenes.pair_track[e]
            if scenes.track_id[p] != last or not _is_free(scenes, work, f, p):
                continue
            before = scenes.same_before[p]
            while before >= 0 and not _is_free(scenes, work, f, before):
                before = scenes.same_before[before]
            d = scenes.pair_distance[e, thin]
            if before < 0 and d < np.inf:
                _take(scenes, work, f, g - first, p, d, True)
            break


@numba.njit(cache=True)
def _match_rest(scenes: Scenes, work: Work, f: int, active: int, thin: int) -> None:
    """Matches what is left: directly where no box has two candidates, else by assignment."""
    first = scenes.truth_edges[f]
    conflict = False
    for g in range(first, scenes.truth_edges[f + 1]):
        if work.match[g - first] >= 0:
            continue
        own = 0
        for e in range(scenes.pair_edges[g], scenes.pair_edges[g + 1]):
            p = scenes.pair_track[e]
            if scenes.pair_distance[e, thin] < np.inf and _is_free(scenes, work, f, p):
                own += 1
                at = p - scenes.track_edges[f]
                work.rivals[at] += 1
                conflict = conflict or own > 1 or work.rivals[at] > 1
    if conflict:
        _assign(scenes, work, f, active, thin)
        return
    for g in range(first, scenes.truth_edges[f + 1]):
        if work.match[g - first] >= 0:
            continue
        for e in range(scenes.pair_edges[g], scenes.pair_edges[g + 1]):
            p = scenes.pair_track[e]
            d = scenes.pair_distance[e, thin]
            if d < np.inf and _is_free(scenes, work, f, p):
                _take(scenes, work, f, g - first, p, d, False)
                break


@numba.njit(cache=True)
def _assign(scenes: Scenes, work: Work, f: int, active: int, thin: int) -> None:
    """Most matches first, least distance second, on the whole frame as the official code does.

    A forbidden pair costs more than all allowed ones together.
    """
    first = scenes.truth_edges[f]
    truth = scenes.truth_edges[f + 1] - first
    turned = active < truth
    cost = work.solver.cost
    furthest = 0.0
    for i in range(truth):
        for e in range(scenes.pair_edges[first + i], scenes.pair_edges[first + i + 1]):
            d = scenes.pair_distance[e, thin]
            if work.match[i] < 0 and d < np.inf and _is_free(scenes, work, f, scenes.pair_track[e]):
                furthest = max(furthest, d)
    forbidden = 2 * min(truth, active) * (furthest + 1.0) + 1.0
    rows, columns = min(truth, active), max(truth, active)
    cost[:rows, :columns] = forbidden
    for i in range(truth):
        for e in range(scenes.pair_edges[first + i], scenes.pair_edges[first + i + 1]):
            d = scenes.pair_distance[e, thin]
            p = scenes.pair_track[e]
            if work.match[i] < 0 and d < np.inf and _is_free(scenes, work, f, p):
                at = work.column[p - scenes.track_edges[f]]
                if turned:
                    cost[at, i] = d
                else:
                    cost[i, at] = d
    solve(work.solver, rows, columns)
    for row in range(rows):
        column = work.solver.column_of_row[row]
        d = cost[row, column]
        if d < forbidden:
            i, at = (column, row) if turned else (row, column)
            _take(scenes, work, f, i, work.active[at], d, False)


@numba.njit(cache=True)
def _record(scenes: Scenes, work: Work, f: int, count: I64, event: I64) -> int:
    """Counts a matched frame and updates its objects; returns the number of hits."""
    first = scenes.truth_edges[f]
    hits = 0
    for g in range(first, scenes.truth_edges[f + 1]):
        o = scenes.truth_object[g]
        p = work.match[g - first]
        event[1, g] = p
        if p < 0:
            event[0, g] = MISS
            count[FN] += 1
            work.state[RUN, o] += 1
            continue
        hits += 1
        last = work.state[LAST, o]
        switched = not work.carried[g - first] and last >= 0 and last != scenes.track_id[p]
        event[0, g] = SWITCH if switched else MATCH
        count[IDS if switched else TP] += 1
        work.state[LAST, o] = scenes.track_id[p]
        if work.state[HITS, o] == 0:
            count[WAIT] += work.state[RUN, o]
        elif work.state[RUN, o] > 0:
            count[FRAG] += 1
        work.state[HITS, o] += 1
        work.state[LONGEST, o] = max(work.state[LONGEST, o], work.state[RUN, o])
        work.state[RUN, o] = 0
    return hits


@numba.njit(cache=True)
def _close(scenes: Scenes, work: Work, scene: int, count: I64) -> None:
    """Adds the figures that are per true track at the end of a scene."""
    for o in range(scenes.object_edges[scene], scenes.object_edges[scene + 1]):
        hits = work.state[HITS, o]
        share = hits / scenes.length[o]
        if share >= 0.8:
            count[MT] += 1
        if share < 0.2:
            count[ML] += 1
        if hits > 0:
            count[TRACKED] += 1
            count[GAP] += max(work.state[LONGEST, o], work.state[RUN, o])

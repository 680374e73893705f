"""Frames, labels, identities, duplicates and coverage of the boxes of a scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from difflib import get_close_matches

import numpy as np

from mottrack.core.concerns import Concern
from mottrack.core.objects import GENERIC
from mottrack.datasets.plausibility.motion import FEWEST
from mottrack.datasets.plausibility.seen import SeenBoxes, SeenScene

FAR_M = 200.0
"""Farther than any LiDAR sees: such boxes are in another frame."""
SAME_PLACE_M = 1e-4
"""Closer, two boxes are one that was written twice: text files have four decimals at most."""
SHORTEST_HOLE_FRAMES, SHORTEST_HOLE_SHARE = 10, 0.25
"""Key frames in a row without any detection that a detector hardly leaves, and their share."""
EMPTY_SHARE = 0.9
"""Of annotated boxes: far and hidden ones hold no return, in the embedded world six of ten."""
REUSED_AFTER_S, REUSED_FROM_M = 10.0, 50.0
"""An identity that comes back so much later and so far away is another object."""


def box_concerns(scene: SeenScene) -> Iterator[Concern]:
    """Yield what is unlikely in the boxes of a scene."""
    for what, boxes in (("annotations", scene.truth.boxes), (scene.found_name, scene.found)):
        if len(boxes):
            yield from _far(scene, boxes, what)
            yield from _labels(scene, boxes, what)
            yield from _duplicates(scene, boxes, what)
    yield from _identities(scene)
    yield from _empty(scene)
    yield from _holes(scene)


def _far(scene: SeenScene, boxes: SeenBoxes, what: str) -> Iterator[Concern]:
    away_m = np.hypot(*(boxes.centre_m - scene.poses[boxes.frame, :3, 3])[:, :2].T)
    if np.median(away_m) > FAR_M:
        text = f"{np.median(away_m):.0f} m in the median (ego instead of global coordinates?)"
        kind = f"{what} far from the vehicle"
        yield from scene.concern(kind, away_m > FAR_M, boxes.frame, text)


def _labels(scene: SeenScene, boxes: SeenBoxes, what: str) -> Iterator[Concern]:
    """Labels that are not scored are usual; not so if all are, or if one is misspelt."""
    # clusters have no class by design
    left_out = ~np.isin(boxes.label, [*(scene.classes or boxes.label), GENERIC])
    counts = Counter(boxes.label[left_out].tolist())
    misspelt = [label for label in counts if _meant(label, scene.classes)]
    if left_out.all() or misspelt:
        found = ", ".join(f"{label} {n}" for label, n in counts.most_common())
        text = f"found {found}; classes {', '.join(scene.classes)}"
        kind = f"{what} of no class of the data set, left out"
        wrong = left_out if left_out.all() else np.isin(boxes.label, misspelt)
        yield from scene.concern(kind, wrong, boxes.frame, text)


def _meant(label: str, classes: tuple[str, ...]) -> bool:
    """Return whether another spelling of a class was meant."""
    lower = label.lower()
    if lower in classes:
        return lower != label
    return bool(get_close_matches(lower[:40], classes, n=1, cutoff=0.85))


def _duplicates(scene: SeenScene, boxes: SeenBoxes, what: str) -> Iterator[Concern]:
    place = np.round(boxes.centre_m / SAME_PLACE_M)
    _, label = np.unique(boxes.label, return_inverse=True)
    keys = np.column_stack([boxes.frame, label.reshape(-1), place])
    again = np.ones(len(boxes), dtype=bool)
    again[np.unique(keys, axis=0, return_index=True)[1]] = False
    yield from scene.concern(f"{what} twice in one place", again, boxes.frame, "")


def _identities(scene: SeenScene) -> Iterator[Concern]:
    boxes, identity = scene.truth.boxes, scene.truth.identity
    order = np.lexsort((boxes.frame, identity))
    same = np.diff(identity[order]) == 0
    before, after = order[:-1][same], order[1:][same]
    changed = boxes.label[before] != boxes.label[after]
    kind = "identities that change their class"
    yield from scene.concern(kind, changed, boxes.frame[after], "")
    gap_s = (scene.stamp_ns[boxes.frame[after]] - scene.stamp_ns[boxes.frame[before]]) * 1e-9
    moved_m = np.linalg.norm(boxes.centre_m[after] - boxes.centre_m[before], axis=1)
    reused = (gap_s > REUSED_AFTER_S) & (moved_m > REUSED_FROM_M)
    text = f"gone for over {REUSED_AFTER_S:g} s and back {REUSED_FROM_M:g} m away"
    yield from scene.concern("identities used again", reused, boxes.frame[after], text)


def _empty(scene: SeenScene) -> Iterator[Concern]:
    known, empty = scene.truth.points >= 0, scene.truth.points == 0
    if known.sum() >= FEWEST and empty.sum() > EMPTY_SHARE * known.sum():
        text = f"of {known.sum()} by the labels' own count"
        kind = "annotations without a return"
        yield from scene.concern(kind, empty, scene.truth.boxes.frame, text)


def _holes(scene: SeenScene) -> Iterator[Concern]:
    """Find long stretches without detections in a scene that has some."""
    keys = np.flatnonzero(scene.is_key)
    if not len(scene.found) or not len(keys):
        return
    none = ~np.isin(keys, scene.found.frame)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], none.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        if end - first >= max(SHORTEST_HOLE_FRAMES, SHORTEST_HOLE_SHARE * len(keys)):
            hole = np.zeros(len(keys), dtype=bool)
            hole[first:end] = True
            text = f"of {len(keys)} key frames"
            kind = f"key frames in a row without {scene.found_name}"
            yield from scene.concern(kind, hole, keys, text)

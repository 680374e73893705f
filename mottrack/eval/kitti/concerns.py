"""What is hardly meant in labels and results of KITTI's format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import Mask
from mottrack.core.concerns import Concern
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.kitti.matching import NEIGHBOURS, KittiRules
from mottrack.formats.kitti_rows import TYPES

KNOWN = tuple(name.lower() for name in TYPES)


class Files(NamedTuple):
    """Labels and results of one sequence, and where they were read."""

    labels: KittiBoxes
    results: KittiBoxes
    labels_path: Path
    results_path: Path


def concerns(files: Files, rules: KittiRules) -> Iterator[Concern]:
    """Yield what is hardly meant in the files of one sequence."""
    for path, boxes in (
        (files.labels_path, files.labels),
        (files.results_path, files.results),
    ):
        yield from _at(path, boxes, ~np.isin(boxes.kind, KNOWN), "rows of no type of KITTI's")
        own = np.isin(boxes.kind, (rules.kind, *NEIGHBOURS[rules.kind]))
        yield from _at(path, boxes, own & (boxes.id < 0), "boxes without an identity, left out")
    results = files.results
    own = results.kind == rules.kind
    if len(results) and not own.any():
        kinds, counts = np.unique(results.kind, return_counts=True)
        found = ", ".join(f"{kind}: {n}" for kind, n in zip(kinds, counts, strict=True))
        text = f"{files.results_path}: no {rules.kind} (rows by type: {found})"
        yield Concern("nothing to score", len(results), text)
    flat = results.image_box[:, 1] == results.image_box[:, 3]
    kind = "results without a height in the image, never counted as false positives"
    yield from _at(files.results_path, results, own & flat, kind)
    if len(files.labels):
        late = results.frame > files.labels.frame.max()
        yield from _at(files.results_path, results, own & late, "results after the last label")


def _at(path: Path, boxes: KittiBoxes, wrong: Mask, kind: str) -> Iterator[Concern]:
    if wrong.any():
        row = int(np.argmax(wrong))
        place = f"{path}: {boxes.kind[row]} {boxes.id[row]} in frame {boxes.frame[row]}"
        yield Concern(kind, int(np.count_nonzero(wrong)), place)

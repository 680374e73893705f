"""CLEAR, IDF1 and HOTA on MOTChallenge text files.

A line is `frame, id, left, top, width, height, confidence, class, visibility`. Files of ten columns
(MOT15, and results) have a position on the ground in place of the class.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import DataError
from mottrack.core.storage import write_text
from mottrack.eval import clear, hota, identity
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.pairs import BoxStream, Extended, Pairs, find_pairs, iou_gate, overlap
from mottrack.formats.text_rows import EXACT_INTEGERS, finite_numbers, read_lines
from mottrack.formats.text_table import aligned
from mottrack.geometry.rectangles import rectangle_iou, rectangle_iou_of_pairs

PEDESTRIAN = 1
DISTRACTORS = (2, 7, 8, 12)
"""Of MOT16 and later: person on vehicle, static person, distractor, reflection."""
# frame, id and four numbers of the box; the ninth column is the visibility, after the class
MIN_FIELDS = 6
FIELDS_WITH_CLASS = 9


@dataclass(frozen=True, slots=True)
class MotBoxes:
    """Boxes of one sequence, by frame."""

    frame: I64
    """(N,) ascending."""
    id: I64
    """(N,)"""
    box: F64
    """(N, 4) left, top, right, bottom in pixels."""
    confidence: F64
    """(N,) 1 where the file has none."""
    kind: I64
    """(N,) class number, -1 where the file has none."""

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: NDArray[Any]) -> MotBoxes:
        """Return the rows that a mask or index picks."""
        return MotBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def read_boxes(path: Path) -> MotBoxes:
    """Read a file; raises DataError that names the broken line or an identity twice in a frame."""
    lines = read_lines(path)
    values = _regular(lines)
    if values is None:
        rows = [_numbers(path, n, line) for n, line in enumerate(lines, 1) if line.strip()]
        values = np.array(rows, np.float64).reshape(-1, 8)
    values = values[np.argsort(values[:, 0], kind="stable")]
    boxes = MotBoxes(
        frame=values[:, 0].astype(np.int64),
        id=values[:, 1].astype(np.int64),
        box=np.column_stack([values[:, 2:4], values[:, 2:4] + values[:, 4:6]]),
        confidence=values[:, 6],
        kind=values[:, 7].astype(np.int64),
    )
    _require_unique(path, boxes)
    return boxes


def _regular(lines: list[str]) -> F64 | None:
    """Return what `_numbers` does of all lines at once; None where they must be read one by one.

    Lines of one length and finite numbers need no message.
    """
    if not any(lines):
        return None
    try:
        values = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
    except ValueError:
        return None
    whole = values[:, :2]
    if values.shape[1] < MIN_FIELDS or not np.isfinite(values).all():
        return None
    if (whole != np.floor(whole)).any() or (np.abs(whole) >= EXACT_INTEGERS).any():
        return None
    rows = np.full((len(values), 8), -1.0)
    rows[:, :MIN_FIELDS] = values[:, :MIN_FIELDS]
    rows[:, 6] = values[:, 6] if values.shape[1] > MIN_FIELDS else 1.0
    if values.shape[1] == FIELDS_WITH_CLASS:
        rows[:, 7] = values[:, 7]
    return rows


def _numbers(path: Path, line: int, text: str) -> list[float]:
    """Return frame, id, box, confidence and class of a line."""
    fields = text.replace(",", " ").split()
    if len(fields) < MIN_FIELDS:
        raise DataError(path, f"line {line}", f"{len(fields)} fields", f"at least {MIN_FIELDS}")
    numbers = finite_numbers(path, line, fields[:8])
    kind = numbers[7] if len(fields) == FIELDS_WITH_CLASS else -1.0
    confidence = numbers[6] if len(numbers) > MIN_FIELDS else 1.0
    return [*numbers[:MIN_FIELDS], confidence, kind]


def _require_unique(path: Path, boxes: MotBoxes) -> None:
    order = np.lexsort((boxes.id, boxes.frame))
    frames, ids = boxes.frame[order], boxes.id[order]
    repeated = np.flatnonzero((frames[1:] == frames[:-1]) & (ids[1:] == ids[:-1]))
    if repeated.size:
        frame, identity = frames[repeated[0]], ids[repeated[0]]
        raise DataError(path, f"id {identity}", f"twice in frame {frame}", "each id once a frame")


@dataclass(frozen=True, slots=True)
class MotScores:
    """Sums of one sequence, or of several together."""

    clear: clear.ClearCounts
    identity: identity.IdentityCounts
    hota: hota.HotaCounts

    def as_dict(self) -> dict[str, Any]:
        """Return the metrics: MOTP is the mean of 1 - IoU, HOTA and its parts that over alpha."""
        c = self.clear
        return {
            "mota": c.mota,
            "motp": c.motp,
            "idf1": self.identity.idf1,
            "idp": self.identity.idp,
            "idr": self.identity.idr,
            **hota.hota(self.hota).as_dict(),
            "truth": c.truth,
            "fp": c.false_positives,
            "fn": c.misses,
            "ids": c.switches,
            "frag": c.fragmentations,
            "mt": c.mostly_tracked,
            "ml": c.mostly_lost,
            "recall": c.recall,
            "precision": c.precision,
        }

    def alphas(self) -> dict[str, list[float]]:
        """Return HOTA and its parts at every localisation threshold alpha."""
        curves = hota.hota(self.hota)
        rows = {name: getattr(curves, name).tolist() for name in curves.__dataclass_fields__}
        return {"alpha": hota.ALPHAS.tolist(), **rows}


def score_files(truth: Path, tracks: Path, min_iou: float = 0.5) -> MotScores:
    """Return the scores of one sequence; raises DataError for a malformed file."""
    return score_boxes(*preprocess(read_boxes(truth), read_boxes(tracks), min_iou), min_iou)


def preprocess(truth: MotBoxes, tracks: MotBoxes, min_iou: float) -> tuple[MotBoxes, MotBoxes]:
    """Leave out what is not evaluated.

    Of truth: rows of confidence 0 and, where there are classes, all but pedestrians. Of the
    tracks: boxes that match a person-like distractor (MOT16 and later).
    """
    if (truth.kind >= 1).any():
        distract = np.isin(truth.kind, DISTRACTORS)
        tracks = tracks.select(~_on_distractors(truth, tracks, distract, min_iou))
        truth = truth.select(truth.kind == PEDESTRIAN)
    return truth.select(truth.confidence != 0), tracks


def _on_distractors(truth: MotBoxes, tracks: MotBoxes, distract: Mask, gate: float) -> Mask:
    """(P,) tracks whose best match among all true boxes is a distractor."""
    out = np.zeros(len(tracks), np.bool_)
    for frame in np.unique(truth.frame[distract]):
        rows, columns = np.flatnonzero(truth.frame == frame), np.flatnonzero(tracks.frame == frame)
        similarity = rectangle_iou(truth.box[rows], tracks.box[columns])
        # as TrackEval: an overlap of the gate itself still matches
        similarity[similarity < gate - np.finfo(np.float64).eps] = 0.0
        i, j = linear_sum_assignment(similarity, maximize=True)
        good = similarity[i, j] > 0.0
        out[columns[j[good & distract[rows[i]]]]] = True
    return out


def score_boxes(truth: MotBoxes, tracks: MotBoxes, min_iou: float = 0.5) -> MotScores:
    """Return the scores of one sequence of boxes."""
    pairs = image_pairs(truth, tracks)
    near = pairs.within(iou_gate(min_iou))
    counts = clear.clear_counts(near, clear.associate(near))
    return MotScores(counts, identity.identity_counts(near), hota.hota_counts(pairs))


def image_pairs(truth: MotBoxes, tracks: MotBoxes) -> Pairs:
    """Return all overlapping pairs of a sequence; frames without any box are left out."""
    listed = np.unique(np.concatenate([truth.frame, tracks.frame]))
    first, second = (BoxStream(np.searchsorted(listed, s.frame), s.id) for s in (truth, tracks))
    true, said = (Extended(side.box, side.box[:, [0, 2]]) for side in (truth, tracks))
    measure = overlap(rectangle_iou, true, said, rectangle_iou_of_pairs)
    return find_pairs(first, second, len(listed), measure)


def together(scores: Sequence[MotScores]) -> MotScores:
    """Return the scores of several sequences together."""
    return MotScores(
        clear.total(s.clear for s in scores),
        identity.total(s.identity for s in scores),
        hota.total(s.hota for s in scores),
    )


def write_outputs(folder: Path, scores: dict[str, MotScores]) -> None:
    """Write mot.json: the metrics of every sequence and HOTA over alpha."""
    content = {name: {**s.as_dict(), "alphas": s.alphas()} for name, s in scores.items()}
    write_text(folder / "mot.json", json.dumps(content, indent=2))


def format_table(scores: dict[str, MotScores]) -> str:
    """Return a line per sequence."""
    columns = ("mota", "motp", "idf1", "hota", "det_a", "ass_a", "loc_a")
    counts = ("truth", "fp", "fn", "ids", "frag", "mt", "ml")
    lines = [["sequence", *columns, *counts]]
    for name, score in scores.items():
        row = score.as_dict()
        lines.append([name, *(f"{row[c]:.4f}" for c in columns), *(str(row[c]) for c in counts)])
    return aligned(lines)

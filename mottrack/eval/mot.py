"""CLEAR, IDF1 and HOTA on MOTChallenge text files.

`mottrack.eval.mot_boxes` reads them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import Mask
from mottrack.core.concerns import Concern
from mottrack.core.storage import write_text
from mottrack.eval import clear, hota, identity
from mottrack.eval.arithmetic import distinct
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.mot_boxes import DISTRACTORS, PEDESTRIAN, MotBoxes, concerns, read_boxes
from mottrack.eval.pairs import BoxStream, Extended, Pairs, find_pairs, iou_gate, overlap
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import aligned
from mottrack.geometry.rectangles import rectangle_iou, rectangle_iou_of_pairs

_RATES = ("mota", "motp", "recall", "precision")
"""Properties of the CLEAR counts that are ratios of sums."""


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


class Scored(NamedTuple):
    """The scores of one sequence, and what of its files is hardly meant."""

    scores: MotScores
    concerns: tuple[Concern, ...]


def score_files(truth: Path, tracks: Path, min_iou: float = 0.5) -> Scored:
    """Return the scores of one sequence; raises DataError for a malformed file."""
    boxes = read_boxes(truth), read_boxes(tracks)
    found = tuple(concerns(*boxes, (truth, tracks)))
    return Scored(score_boxes(*preprocess(*boxes, min_iou), min_iou), found)


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
    for frame in distinct(truth.frame[distract]):
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
    listed = distinct(np.concatenate([truth.frame, tracks.frame]))
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


def intervals(scores: Sequence[MotScores], resamples: int) -> dict[str, list[float]]:
    """Return the ends of the 95 % interval of each metric over sequences, NaN for one sequence."""
    from mottrack.eval.additive import hota_metrics, identity_metrics, property_metric, sampled
    from mottrack.eval.paired import draw

    counts = [s.clear for s in scores]
    metrics = {name: property_metric(counts, name) for name in _RATES}
    metrics |= identity_metrics([s.identity for s in scores])
    metrics |= hota_metrics([s.hota for s in scores])
    found = sampled(metrics, draw(len(scores), resamples))
    return {name: list(metric.interval()) for name, metric in found.items()}


def write_outputs(
    folder: Path, scores: dict[str, MotScores], ends: dict[str, list[float]] | None = None
) -> None:
    """Write mot.json: the metrics of every sequence and HOTA over alpha; intervals of all."""
    content = {name: {**s.as_dict(), "alphas": s.alphas()} for name, s in scores.items()}
    if ends:
        content["all"]["intervals"] = strict(ends)
    write_text(folder / "mot.json", json.dumps(content, indent=2))


def format_intervals(score: MotScores, ends: dict[str, list[float]]) -> str:
    """Return a line per metric of all sequences together."""
    row = score.as_dict()
    if all(np.isnan(low) for low, _ in ends.values()):
        return "only one sequence: no confidence interval"
    lines = [["metric", "all", "95 % interval over sequences"]]
    for name, (low, high) in ends.items():
        lines.append([name, f"{row[name]:.4f}", f"[{low:.4f}, {high:.4f}]"])
    return aligned(lines)


def format_table(scores: dict[str, MotScores]) -> str:
    """Return a line per sequence."""
    columns = ("mota", "motp", "idf1", "hota", "det_a", "ass_a", "loc_a")
    counts = ("truth", "fp", "fn", "ids", "frag", "mt", "ml")
    lines = [["sequence", *columns, *counts]]
    for name, score in scores.items():
        row = score.as_dict()
        lines.append([name, *(f"{row[c]:.4f}" for c in columns), *(str(row[c]) for c in counts)])
    return aligned(lines)

"""HOTA and IDF1 of 3-D scenes beside the official metrics.

They need one set of tracks, so each class has the tracks above its threshold of best MOTA, where
the official summary reads its counts. Boxes are as prepared for AMOTA; similarity falls from 1 to 0
over the match distance.
"""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from mottrack.eval import hota, identity
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.metrics import Metrics
from mottrack.eval.pairs import BoxStream, centre_distance, find_pairs
from mottrack.formats.text_table import aligned

Counts = tuple[identity.IdentityCounts, hota.HotaCounts]
Scores = dict[str, dict[str, float]]


def identity_scores(prepared: Prepared, metrics: Metrics) -> Scores:
    """Return class, or "all", to HOTA, its parts, IDF1, IDP and IDR.

    "all" adds the counts of the classes up. A class that reaches no recall level has no tracks.
    """
    parts = {
        name: _class_counts(prepared, label, metrics)
        for label, name in enumerate(metrics.rules.classes)
    }
    scores = {name: _scores(*part) for name, part in parts.items()}
    return scores | {"all": _scores(*_total(parts.values()))}


def _class_counts(prepared: Prepared, label: int, metrics: Metrics) -> Counts:
    curves = metrics.curves[metrics.rules.classes[label]]
    mota = curves["mota"]
    best = np.inf if np.isnan(mota).all() else curves["confidence"][int(np.nanargmax(mota))]
    truth = prepared.truth.select(prepared.truth.label == label)
    tracks = prepared.tracks.select(prepared.tracks.label == label)
    tracks = tracks.select(tracks.score >= best)
    counts = [
        _scene_counts(_of_scene(truth, a, b), _of_scene(tracks, a, b), b - a, metrics)
        for a, b in pairwise(prepared.samples.first.tolist())
    ]
    return _total(counts)


def _total(counts: Iterable[Counts]) -> Counts:
    listed = list(counts)
    return identity.total(c[0] for c in listed), hota.total(c[1] for c in listed)


def _of_scene(boxes: BoxTable, first: int, end: int) -> BoxTable:
    rows = np.arange(*np.searchsorted(boxes.sample, [first, end]))
    part = boxes.select(rows)
    part.sample[:] -= first
    return part


def _scene_counts(truth: BoxTable, tracks: BoxTable, frames: int, metrics: Metrics) -> Counts:
    gate = metrics.rules.match_distance_m
    pairs = find_pairs(
        BoxStream(truth.sample, truth.track),
        BoxStream(tracks.sample, tracks.track),
        frames,
        centre_distance(truth.centre_m, tracks.centre_m, gate),
    )
    return identity.identity_counts(pairs.within(gate)), hota.hota_counts(pairs)


def _scores(ids: identity.IdentityCounts, sums: hota.HotaCounts) -> dict[str, float]:
    return {
        **hota.hota(sums).as_dict(),
        "idf1": ids.idf1,
        "idp": ids.idp,
        "idr": ids.idr,
    }


def format_identity(scores: Scores) -> str:
    """Return a line per class."""
    columns = list(scores["all"])
    lines = [[name, *(f"{row[c]:.3f}" for c in columns)] for name, row in scores.items()]
    return aligned([["class", *columns], *lines])

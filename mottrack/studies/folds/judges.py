"""Figures of a group's tracks by the rules of its data set, for any part of its scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.eval.evaluation import score
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.kitti.concerns import Files
from mottrack.eval.kitti.identity_scores import identity_sums, total
from mottrack.eval.kitti.levels import KittiMetrics, evaluate
from mottrack.eval.kitti.matching import CLASSES, KittiRules, prepare
from mottrack.eval.kitti.matching import Sequence as Prepared
from mottrack.eval.scores import ScoreConfig, Scores

NOT_DEFINED = float("nan")
"""A figure that the rules do not have, or of no class."""


class Figures(NamedTuple):
    """Of one class, or the mean over classes; NaN where the rules do not have it."""

    amota: float
    samota: float
    """AMOTA with MOTA scaled by the recall: nuScenes' AMOTA is that already."""
    mota: float
    """At the score of the best MOTA, as HOTA and switches."""
    hota: float
    switches: float

    def value(self, name: str) -> float:
        """Return a figure to choose by; AMOTA is the scaled one where there are two."""
        if name == "amota" and np.isfinite(self.samota):
            return self.samota
        return float(getattr(self, name))


ByClass = dict[str, Figures]


class Judge(Protocol):
    """Holds the tracks of a group's scenes."""

    def figures(self, scenes: Sequence[str], *, hota: bool = True) -> ByClass:
        """Return the figures of some scenes together, for each class that has truth in them.

        HOTA takes half the time; without it, it is NaN.
        """


def mean_figure(found: Mapping[str, Figures], name: str) -> float:
    """Return the mean over classes of one figure; NaN without a class."""
    values = [value for one in found.values() if np.isfinite(value := one.value(name))]
    return float(np.mean(values)) if values else NOT_DEFINED


class NuScenesJudge:
    """nuScenes' tracking metrics; HOTA by centre distance."""

    def __init__(self, results: Mapping[str, SceneResult], config: ScoreConfig) -> None:
        self._results, self._config = results, config
        self._known: dict[tuple[str, ...], ByClass] = {}

    def figures(self, scenes: Sequence[str], *, hota: bool = True) -> ByClass:
        """Return the figures of some scenes together; HOTA costs nothing beside the others."""
        key = tuple(scenes)
        if key not in self._known:
            self._known[key] = _of_scores(score([self._results[s] for s in key], self._config))
        found = self._known[key]
        return found if hota else {k: one._replace(hota=NOT_DEFINED) for k, one in found.items()}


def _of_scores(scores: Scores) -> ByClass:
    return {
        name: Figures(
            one.amota, NOT_DEFINED, one.clear.mota, one.as_dict()["hota"], one.clear.switches
        )
        for name, one in scores.classes.items()
        if one.clear.truth
    }


class KittiJudge:
    """AB3DMOT's protocol at 3-D IoU .25; HOTA by KITTI's rules on the same overlap."""

    def __init__(self, files: Mapping[str, Files]) -> None:
        self._files = files
        self._known: dict[tuple[bool, tuple[str, ...]], ByClass] = {}

    @cached_property
    def _prepared(self) -> dict[str, dict[str, Prepared]]:
        """Class and sequence to its overlaps, which serve every part of the sequences."""
        return {
            kind: {
                name: prepare(one.labels, one.results, KittiRules(kind=kind))
                for name, one in self._files.items()
            }
            for kind in CLASSES
        }

    def figures(self, scenes: Sequence[str], *, hota: bool = True) -> ByClass:
        """Return the figures of some scenes together, for each class that has truth in them."""
        key = (hota, tuple(scenes))
        if key not in self._known:
            found = {kind: self._of_class(kind, key[1], hota) for kind in CLASSES}
            self._known[key] = {kind: one for kind, one in found.items() if one is not None}
        return self._known[key]

    def _of_class(self, kind: str, scenes: Sequence[str], hota: bool) -> Figures | None:
        rules = KittiRules(kind=kind)
        prepared = [self._prepared[kind][name] for name in scenes]
        if not any((~one.ignored_truth).any() for one in prepared):
            return None
        metrics = evaluate(prepared, rules)
        return Figures(
            metrics.amota,
            metrics.samota,
            metrics.best.mota,
            self._hota(metrics, scenes) if hota else NOT_DEFINED,
            metrics.best.counts.ids,
        )

    def _hota(self, metrics: KittiMetrics, scenes: Sequence[str]) -> float:
        rules, least = metrics.rules, metrics.best.threshold
        sums = [identity_sums(self._files[name], rules, least) for name in scenes]
        return total(sums).as_dict()["hota"]


def settled(boxes: KittiBoxes) -> KittiBoxes:
    """Return the same boxes with one score a track, rounded so that its mean is exact.

    The protocol compares a track's mean with thresholds that are such means, and averages anew in
    every pass: without this the last bit decides whether a track takes part.
    """
    if not len(boxes):
        return boxes
    # files of several classes are joined, each with identities of its own
    named = np.char.add(np.char.add(boxes.kind, " "), boxes.id.astype(np.str_))
    _, track = np.unique(named, return_inverse=True)
    mean = np.bincount(track, boxes.score) / np.bincount(track)
    # a power of two: sums of equal scores are then exact
    score = (np.round(1024.0 * mean) / 1024.0)[track]
    columns = {name: getattr(boxes, name) for name in boxes.__dataclass_fields__}
    return KittiBoxes(**columns | {"score": score})


def files_of(labels: KittiBoxes, results: KittiBoxes) -> Files:
    """Return labels and results that were never files."""
    return Files(labels, settled(results), Path(), Path())

"""HOTA and MOTA at ten score thresholds: the best of them, and their mean (AMOTA).

For each category the thresholds are those at which ten shares of its true boxes are matched, from
0.1 to 1. At each of them the boxes of tracks with a lower score are left out, box by box, and all
logs are evaluated together. The reported value is the best of the ten; AMOTA is the mean of the ten
MOTAs, negative ones as 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.eval import clear, hota
from mottrack.eval.additive import AdditiveMetric
from mottrack.eval.argoverse2.boxes import CategoryPairs, Log, category_pairs, within_range
from mottrack.eval.argoverse2.rules import CATEGORIES, Argoverse2Rules, Objective
from mottrack.eval.clear import ClearCounts
from mottrack.eval.hota import HotaCounts
from mottrack.eval.trackeval_clear import trackeval_counts

FIGURES = ("hota", "mota", "amota", "ahota")
"""The best HOTA and MOTA of the levels, and the means over the levels."""


@dataclass(frozen=True, slots=True)
class LevelCounts:
    """The counts at one threshold, of each of the S logs."""

    hota: tuple[HotaCounts, ...]
    clear: tuple[ClearCounts, ...]


@dataclass(frozen=True, slots=True)
class CategoryMetrics:
    """One category of all logs."""

    thresholds: F64
    """(L,) score thresholds, of the highest recall first; 0 where that recall is not reached."""
    levels: tuple[LevelCounts, ...]
    """(L,)"""
    truth: int
    """True boxes within range."""

    def metric(self, figure: str) -> AdditiveMetric:
        """Return one of `FIGURES` as a function of how often each log counts.

        The thresholds stay those of all logs.
        """
        kind, formula = ("hota", _mean_hota) if figure.endswith("hota") else ("clear", _mota)
        parts = tuple(tuple(getattr(level, kind)) for level in self.levels)
        over = _mean_over_levels if figure.startswith("a") else _best_level
        return AdditiveMetric(parts, lambda *counts: over([formula(c) for c in counts]))

    def figures(self) -> dict[str, float]:
        """Return all of `FIGURES`."""
        return {name: self.metric(name).whole for name in FIGURES}

    def best(self, objective: Objective) -> int:
        """Return the level of the best HOTA or MOTA, the first of equal ones."""
        counts = [self._total(level) for level in range(len(self.levels))]
        if objective == "hota":
            return int(np.argmax([_mean_hota(h) for h, _ in counts]))
        return int(np.argmax([_mota(c) for _, c in counts]))

    def at(self, level: int) -> dict[str, Any]:
        """Return everything at one level; HOTA and its parts are means over alpha."""
        parts, counts = self._total(level)
        return {
            "threshold": float(self.thresholds[level]),
            **hota.hota(parts).as_dict(),
            "mota": float(_mota(counts)),
            "motp": 1.0 - counts.motp if counts.hits else 0.0,
            "tp": counts.hits,
            "fp": counts.false_positives,
            "fn": counts.misses,
            "ids": counts.switches,
            "frag": counts.fragmentations,
            "mt": counts.mostly_tracked,
            "ml": counts.mostly_lost,
            "truth": counts.truth,
            "truth_tracks": counts.truth_tracks,
        }

    def _total(self, level: int) -> tuple[HotaCounts, ClearCounts]:
        counts = self.levels[level]
        return hota.total(counts.hota), clear.total(counts.clear)


def evaluate(
    logs: Sequence[Log], rules: Argoverse2Rules | None = None
) -> dict[str, CategoryMetrics]:
    """Return the metrics of every category, of those without any box too.

    Raises:
        InputError: there is no log, or no true box of a category within range.
    """
    rules = rules or Argoverse2Rules()
    near = [within_range(log, rules) for log in logs]
    if not any((log.truth.category >= 0).any() for log in near):
        raise InputError("truth", "without a box that counts", f"one within {rules.max_range_m} m")
    return {name: _category(near, k, rules) for k, name in enumerate(CATEGORIES)}


def _category(logs: Sequence[Log], category: int, rules: Argoverse2Rules) -> CategoryMetrics:
    found = [category_pairs(log, category, rules) for log in logs]
    truth = sum(len(f.pairs.truth) for f in found)
    scores = np.concatenate([f.matched for f in found])
    thresholds = score_thresholds(scores, truth, rules)
    at = {t: _level(found, t, rules) for t in np.unique(thresholds).tolist()}
    return CategoryMetrics(thresholds, tuple(at[t] for t in thresholds.tolist()), truth)


def _level(found: Sequence[CategoryPairs], threshold: float, rules: Argoverse2Rules) -> LevelCounts:
    chosen = [f.pairs.of_tracks(f.score >= threshold) for f in found]
    return LevelCounts(
        tuple(hota.hota_counts(pairs) for pairs in chosen),
        tuple(trackeval_counts(pairs, rules.min_similarity) for pairs in chosen),
    )


def score_thresholds(scores: F64, truth: int, rules: Argoverse2Rules) -> F64:
    """Return the threshold of each recall level, the highest recall first (L,).

    Args:
        scores: (M,) of matched track boxes.
        truth: number of true boxes.
        rules: say how many levels.

    >>> score_thresholds(np.array([0.9, 0.8, 0.6]), 4, Argoverse2Rules(levels=3)).round(2).tolist()
    [0.0, 0.76, 0.9]
    """
    recalls = np.linspace(rules.min_recall, 1.0, rules.levels).round(12)[::-1]
    if not len(scores):
        return np.zeros(rules.levels)
    reached: F64 = np.arange(1, len(scores) + 1) / truth
    found = np.interp(recalls, reached, np.sort(scores)[::-1], right=0.0)
    return np.where(recalls > reached[-1], 0.0, found)


def _mean_hota(counts: HotaCounts) -> F64:
    return np.asarray(hota.hota(counts).hota.mean(axis=-1))


def _mota(counts: ClearCounts) -> F64:
    # without truth TrackEval divides by 1
    right = np.asarray(counts.matches - counts.false_positives, np.float64)
    return np.asarray(right / np.maximum(1.0, counts.truth))


def _best_level(values: Sequence[F64]) -> F64:
    return np.asarray(np.maximum(0.0, np.max(values, axis=0)))


def _mean_over_levels(values: Sequence[F64]) -> F64:
    return np.asarray(np.mean(np.maximum(0.0, values), axis=0))


def mean_over_categories(metrics: dict[str, CategoryMetrics], figure: str) -> Callable[[I64], F64]:
    """Return the mean of a figure over the categories that have truth, by weights (B, S)."""
    scored = [m.metric(figure) for m in metrics.values() if m.truth]
    return lambda weights: np.mean([metric.values(weights) for metric in scored], axis=0)

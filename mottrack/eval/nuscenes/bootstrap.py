"""How sure a figure is, and whether one submission is better than another.

Scenes are drawn with replacement, as many as there are: frames of a scene are not independent. An
interval is between percentiles of the figure over the resamples. Two submissions are compared on
the same resamples, which cancels what both find hard.

AMOTA does not add up over scenes: its thresholds depend on all of them. `profiles` reduces each
class to counters per scene from which every resample is evaluated in milliseconds; `resampled`
with `evaluate_prepared` does the same the long way. Counts agree exactly, other figures to the
rounding of sums (1e-9).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared, Samples
from mottrack.eval.nuscenes.levels import class_scenes
from mottrack.eval.nuscenes.profile import Profile, make_profile, weighted_curves
from mottrack.eval.nuscenes.rules import SUMMARY_METRICS, Rules
from mottrack.eval.nuscenes.summary import Metrics, summarise

LOWER_IS_BETTER = frozenset({"amotp", "motp", "ml", "faf", "fp", "fn", "ids", "frag", "tid", "lgd"})


@dataclass(frozen=True, slots=True)
class Interval:
    """A figure with what the resamples say about it."""

    value: float
    """On the data as it is."""
    low: float
    high: float
    undefined: int = 0
    """Resamples without the figure (no truth of the class), left out."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The second submission's figure minus the first's."""

    interval: Interval
    probability_better: float
    """Share of the resamples in which the second is better; equal ones count half."""


Figures = dict[str, dict[str, float]]
"""Class, or "all", to metric to value."""


def profiles(prepared: Prepared, rules: Rules) -> list[Profile]:
    """The counters of every class of the rules."""
    return [make_profile(class_scenes(prepared, k, rules)) for k in range(len(rules.classes))]


def draw(scenes: int, resamples: int, seed: int = 0) -> I64:
    """(resamples, scenes) how often each scene is drawn.

    Raises:
        InputError: there is no scene, or no resample is asked for.
    """
    for name, count in (("scenes", scenes), ("resamples", resamples)):
        if count < 1:
            raise InputError(name, count, "at least 1")
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=resamples)
    return drawn.astype(np.int64)


def evaluate_weighted(classes: Sequence[Profile], weight: I64, rules: Rules) -> Metrics:
    """The metrics when scene s counts `weight[s]` times."""
    curves = {
        name: weighted_curves(profile, weight, rules)
        for name, profile in zip(rules.classes, classes, strict=True)
    }
    return summarise(curves, rules)


def figures_of(metrics: Metrics) -> Figures:
    """The figures of every class and of all."""
    return {**metrics.classes, "all": metrics.total}


def intervals(
    classes: Sequence[Profile], weights: I64, rules: Rules, confidence: float = 0.95
) -> dict[str, dict[str, Interval]]:
    """Confidence intervals of every metric, per class and in total."""
    whole = figures_of(evaluate_weighted(classes, np.ones(weights.shape[1], np.int64), rules))
    draws = [figures_of(evaluate_weighted(classes, weight, rules)) for weight in weights]
    return {
        label: {
            name: interval(whole[label][name], _column(draws, label, name), confidence)
            for name in SUMMARY_METRICS
        }
        for label in whole
    }


def compare(
    pair: tuple[Sequence[Profile], Sequence[Profile]],
    weights: I64,
    rules: Rules,
    confidence: float = 0.95,
) -> dict[str, dict[str, Difference]]:
    """Paired differences of every metric, per class and in total, on the same resamples."""
    ones = np.ones(weights.shape[1], np.int64)
    whole = [figures_of(evaluate_weighted(classes, ones, rules)) for classes in pair]
    draws = [
        [figures_of(evaluate_weighted(classes, weight, rules)) for weight in weights]
        for classes in pair
    ]
    out: dict[str, dict[str, Difference]] = {}
    for label in whole[0]:
        out[label] = {}
        for name in SUMMARY_METRICS:
            columns = [_column(side, label, name) for side in draws]
            change = columns[1] - columns[0]
            value = whole[1][label][name] - whole[0][label][name]
            out[label][name] = difference(name, value, change, confidence)
    return out


def _column(draws: Sequence[Figures], label: str, name: str) -> F64:
    return np.array([figures[label][name] for figures in draws])


def interval(value: float, draws: F64, confidence: float = 0.95) -> Interval:
    """Percentile interval of a figure from its resamples (B,), NaN left out."""
    known = draws[~np.isnan(draws)]
    if not len(known):
        return Interval(value, float("nan"), float("nan"), len(draws))
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(known, [tail, 1.0 - tail])
    return Interval(value, float(low), float(high), len(draws) - len(known))


def difference(name: str, value: float, change: F64, confidence: float = 0.95) -> Difference:
    """Interval and probability of improvement from the changes in the resamples (B,)."""
    known = change[~np.isnan(change)]
    gain = -known if name in LOWER_IS_BETTER else known
    better = np.mean((gain > 0) + 0.5 * (gain == 0)) if len(known) else float("nan")
    return Difference(interval(value, change, confidence), float(better))


def resampled(prepared: Prepared, weight: I64) -> Prepared:
    """The data in which scene s is there `weight[s]` times, under new identities (S,)."""
    scenes = np.repeat(np.arange(len(weight)), weight)
    first = prepared.samples.first
    parts = [np.arange(first[s], first[s + 1]) for s in scenes]
    samples = prepared.samples
    rows = np.concatenate(parts)
    edges = np.cumsum([0, *(len(part) for part in parts)]).astype(np.int64)
    copied = Samples(
        scene_name=np.array([f"{samples.scene_name[s]}#{k}" for k, s in enumerate(scenes)]),
        first=edges,
        token=samples.token[rows],
        stamp_us=samples.stamp_us[rows],
        ego_xy_m=samples.ego_xy_m[rows],
    )
    moves = list(zip(scenes.tolist(), edges[:-1].tolist(), strict=True))
    truth = _copies(prepared.truth, samples, moves)
    return Prepared(copied, truth, _copies(prepared.tracks, samples, moves))


def _copies(boxes: BoxTable, samples: Samples, moves: list[tuple[int, int]]) -> BoxTable:
    """The boxes of each (scene, its new first sample), with identities of their own."""
    ends = np.searchsorted(boxes.sample, samples.first)
    tracks = int(boxes.track.max(initial=0)) + 1
    parts = []
    for copy, (scene, first) in enumerate(moves):
        part = boxes.select(np.arange(ends[scene], ends[scene + 1]))
        sample = part.sample - samples.first[scene] + first
        parts.append(replace(part, sample=sample, track=part.track + copy * tracks))
    return BoxTable.stacked(*parts)


def as_plain(table: Any) -> Any:
    """Intervals and differences as plain dictionaries, for JSON."""
    if isinstance(table, dict):
        return {key: as_plain(value) for key, value in table.items()}
    if isinstance(table, Interval | Difference):
        return {f.name: as_plain(getattr(table, f.name)) for f in fields(table)}
    return table

"""From curves to the official summary: AMOTA, AMOTP, the best level, totals over classes."""

from dataclasses import dataclass

import numpy as np

from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared
from mottrack.eval.nuscenes.levels import Curves, class_curves, class_scenes
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.rules import (
    LEVEL_METRICS,
    METRIC_WORST,
    SUMMARY_METRICS,
    SUMMED_METRICS,
    Rules,
)

AVERAGED = {"amota": "motar", "amotp": "motp"}


@dataclass(frozen=True, slots=True)
class Metrics:
    """The official figures."""

    rules: Rules
    total: dict[str, float]
    """Metric name to value over all classes."""
    classes: dict[str, dict[str, float]]
    """Class to metric to value; NaN for a class without truth."""
    curves: dict[str, Curves]
    """Class to its metrics at every recall level."""


def evaluate(truth: GroundTruth, predictions: BoxTable, rules: Rules | None = None) -> Metrics:
    """The official tracking metrics of predictions.

    Raises InputError where no true or no predicted box is left to evaluate.
    """
    rules = rules or Rules()
    return evaluate_prepared(prepare(truth, predictions, rules), rules)


def evaluate_prepared(prepared: Prepared, rules: Rules) -> Metrics:
    """The metrics of boxes that are filtered and interpolated already."""
    curves = {
        name: class_curves(class_scenes(prepared, label, rules), rules)
        for label, name in enumerate(rules.classes)
    }
    return summarise(curves, rules)


def summarise(curves: dict[str, Curves], rules: Rules) -> Metrics:
    """Metrics of each class and in total from its curves."""
    classes = {name: class_summary(curve) for name, curve in curves.items()}
    return Metrics(rules, total_of(list(classes.values())), classes, curves)


def class_summary(curves: Curves) -> dict[str, float]:
    """The figures of a class: averages over the levels, the rest at the level of best MOTA.

    Of equal MOTA the highest recall counts. Levels not reached count as worst in the averages.
    """
    if np.isnan(curves["mota"]).all():
        return dict.fromkeys(SUMMARY_METRICS, float("nan"))
    best = int(np.nanargmax(curves["mota"]))
    figures = {name: float(curves[name][best]) for name in LEVEL_METRICS}
    for name, source in AVERAGED.items():
        values = curves[source]
        filled = np.where(np.isnan(values), METRIC_WORST[name], values)
        figures[name] = float("nan") if np.isnan(values).all() else float(np.mean(filled))
    return {name: figures[name] for name in SUMMARY_METRICS}


def total_of(classes: list[dict[str, float]]) -> dict[str, float]:
    """Counts summed, all else averaged over the classes that have a value."""
    total = {}
    for name in SUMMARY_METRICS:
        values = np.array([figures[name] for figures in classes])
        known = values[~np.isnan(values)]
        if name in SUMMED_METRICS:
            total[name] = float(known.sum())
        else:
            total[name] = float(known.mean()) if len(known) else float("nan")
    return total

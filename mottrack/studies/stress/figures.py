"""Figures of a run under stress, each on resamples of the scenes."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.eval import clear, hota, identity
from mottrack.eval.additive import AdditiveMetric
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.paired import MetricKey, Sampled, sample
from mottrack.eval.run_metrics import OFFICIAL, Resampling, run_metrics
from mottrack.eval.scores import scene_scores, scored_part

VELOCITY = "velocity_error_mps"
LOWER = ("id_switches", "false_positives", VELOCITY)
"""Figures that are better when lower."""
FIGURES = ("amota", "mota", "idf1", "hota", "recall", "id_switches", "false_positives", VELOCITY)
_VELOCITY_KEY = MetricKey("velocity", "all", "mean", "m/s")


def stress_key(figure: str) -> MetricKey:
    """Return the key of a figure."""
    return MetricKey("stress", "all", figure, lower_is_better=figure in LOWER)


def sampled_figures(run: Evaluation, common: Resampling) -> dict[str, Sampled]:
    """Return every figure of a run with its values on the resamples.

    AMOTA seeks its thresholds anew in every resample, as everywhere; the others are those of all
    boxes at the scores that the whole run is best with.

    Args:
        run: S scenes.
        common: resamples and rules, those of the undamaged run.
    """
    weights = common.weights
    official = run_metrics(run, common)
    unknown = Sampled(np.nan, np.full(len(weights), np.nan), np.zeros(len(run.results), np.bool_))
    found = _counted(run, weights)
    found["amota"] = unknown if common.rules is None else official.get(OFFICIAL[0], unknown)
    found[VELOCITY] = official.get(_VELOCITY_KEY, unknown)
    return {name: found[name] for name in FIGURES}


def _counted(run: Evaluation, weights: I64) -> dict[str, Sampled]:
    config, filters = run.config, run.filters
    parts = [scored_part(result, config) for result in run.results]
    scenes = [[scene_scores(part, one, config) for one in filters] for part in parts]
    counts = [clear.total(s.clear for s in scene) for scene in scenes]
    whole = [identity.total(s.identity for s in scene) for scene in scenes]
    higher = [hota.total(s.hota for s in scene) for scene in scenes]
    metrics = {
        "mota": AdditiveMetric((counts,), lambda c: c.mota),
        "recall": AdditiveMetric((counts,), lambda c: c.recall),
        "id_switches": AdditiveMetric((counts,), lambda c: c.switches),
        "false_positives": AdditiveMetric((counts,), lambda c: c.false_positives),
        "idf1": AdditiveMetric((whole,), lambda c: c.idf1),
        "hota": AdditiveMetric((higher,), _hota),
    }
    return {name: sample(metric, weights) for name, metric in metrics.items()}


def _hota(counts: hota.HotaCounts) -> F64:
    found: F64 = hota.hota(counts).hota.mean(axis=-1)
    return found

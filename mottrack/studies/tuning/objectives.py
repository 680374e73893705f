"""What a search optimises, from the results of all scenes together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.eval.evaluation import score
from mottrack.eval.paired import MetricKey, PairedDifference, student_interval
from mottrack.eval.scores import ScoreConfig, Scores


class Objective(NamedTuple):
    """A figure of a run; higher is better unless `lower_is_better`."""

    name: str
    of: Callable[[Scores], float]
    lower_is_better: bool = False
    unit: str = ""

    def figure(self, scores: Scores) -> float:
        """Return the figure of a run; the worst possible where it does not exist."""
        found = self.of(scores)
        return found if np.isfinite(found) else float("inf" if self.lower_is_better else "-inf")

    @property
    def key(self) -> MetricKey:
        """Its name in tables."""
        return MetricKey("tuning", "all", self.name, self.unit, self.lower_is_better)


OBJECTIVES = {
    "amota": Objective("AMOTA", lambda s: s.overall.amota),
    "mota": Objective("MOTA", lambda s: s.overall.clear.mota),
    "hota": Objective("HOTA", lambda s: s.overall.as_dict()["hota"]),
    "idf1": Objective("IDF1", lambda s: s.overall.identity.idf1),
    "velocity_error": Objective(
        "velocity error", lambda s: s.velocity["all"].mean_mps, lower_is_better=True, unit="m/s"
    ),
}


def differences(
    objectives: Sequence[Objective],
    baseline: Sequence[SceneResult],
    run: Sequence[SceneResult],
    config: ScoreConfig,
) -> list[PairedDifference]:
    """Return the differences of two runs over the same S scenes, with jackknife intervals.

    The figures are computed S times without one scene each; the variance of a difference is
    (S - 1) / S times the sum of squares of these about their mean (Efron, 1982), and the interval
    Student's.
    """
    scenes = len(baseline)
    whole = [score(results, config) for results in (baseline, run)]
    left_out = [
        [score(_but(results, k), config) for results in (baseline, run)] for k in range(scenes)
    ]
    found = []
    for one in objectives:
        gains = np.array([one.figure(b) - one.figure(a) for a, b in left_out])
        a, b = (one.figure(scores) for scores in whole)
        deviation = float(np.sqrt((scenes - 1) * np.mean((gains - gains.mean()) ** 2)))
        low, high = student_interval(b - a, deviation, scenes)
        found.append(PairedDifference(one.key, a, b, low, high, scenes))
    return found


def _but(results: Sequence[SceneResult], k: int) -> list[SceneResult]:
    """Return the results without scene k, or all if it is the only one."""
    return [result for i, result in enumerate(results) if i != k or len(results) == 1]

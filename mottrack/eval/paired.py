"""Paired differences between runs on the same scenes, with confidence intervals.

Scenes are drawn with replacement, the same ones for every run, and every metric is evaluated again
on each resample: exactly, since a scene enters as counters that add up (`Ratio`, `Variance`), as
its sorted errors (`TailMean`), or as the profile of the official metrics
(eval/nuscenes/profile.py).

An interval is difference +- t * sqrt(n / (n - 1)) * s with s the standard deviation over the
resamples and t the 97.5 % quantile of Student's distribution with n - 1 degrees of freedom, n the
scenes that have anything to say about the figure. For a mean this is the textbook t interval, so it
keeps its word with few scenes too, where percentiles of the resamples are far too narrow. One
scene has no interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.stats import t as student_t

from mottrack.core.arrays import F64, I64, Mask

RESAMPLES = 400
CONFIDENCE = 0.95
WORST_SHARE = 0.05
ALIKE = 1e-12  # a spread below this share of the figure is the rounding of sums


@dataclass(frozen=True, slots=True)
class MetricKey:
    """Names one figure of a run."""

    table: str
    """"tracking", "velocity", "flow" or "runtime"."""
    row: str
    """Row of that table."""
    metric: str
    unit: str = field(default="", compare=False)
    lower_is_better: bool = field(default=True, compare=False)


class Metric(Protocol):
    """A figure of a run as a function of how often each of its S scenes counts."""

    @property
    def present(self) -> Mask:
        """(S,) the scenes that have anything to say about it."""
        ...

    def values(self, weights: I64) -> F64:
        """(B,) the figure when scene s counts `weights[b, s]` times; NaN where it has no data."""
        ...


@dataclass(frozen=True, slots=True)
class Ratio:
    """A mean or a share: sums over sums; its root for a root mean square."""

    total: F64
    """(S,)"""
    count: F64
    """(S,)"""
    root: bool = False

    @property
    def present(self) -> Mask:
        """(S,) scenes that count."""
        return np.asarray(self.count > 0)

    def values(self, weights: I64) -> F64:
        """(B,) the figure of each resample."""
        ratio = _divided(weights @ self.total, weights @ self.count)
        return np.sqrt(ratio) if self.root else ratio


@dataclass(frozen=True, slots=True)
class Sum:
    """A count."""

    total: F64
    """(S,)"""

    @property
    def present(self) -> Mask:
        """(S,) every scene: none counted is a finding too."""
        return np.ones(len(self.total), np.bool_)

    def values(self, weights: I64) -> F64:
        """(B,) the figure of each resample."""
        summed: F64 = weights @ self.total
        return summed


@dataclass(frozen=True, slots=True)
class Variance:
    """Population variance of values whose sums and squared sums are known per scene."""

    total: F64
    squares: F64
    count: F64

    @property
    def present(self) -> Mask:
        """(S,) scenes that count."""
        return np.asarray(self.count > 0)

    def values(self, weights: I64) -> F64:
        """(B,) the figure of each resample."""
        count = weights @ self.count
        mean = _divided(weights @ self.total, count)
        return np.maximum(_divided(weights @ self.squares, count) - mean**2, 0.0)


@dataclass(frozen=True, slots=True)
class TailMean:
    """Mean of the largest 5 % of the errors (at least one), as velocity_error.error_row has it."""

    error: F64
    """(N,) the largest first."""
    scene: I64
    """(N,) of each error."""
    scenes: int

    @classmethod
    def of(cls, parts: list[F64]) -> TailMean:
        """From the errors of each scene."""
        error = np.concatenate(parts) if parts else np.zeros(0)
        scene = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        order = np.argsort(-error, kind="stable")
        return cls(error[order], scene[order], len(parts))

    @property
    def present(self) -> Mask:
        """(S,) scenes with errors."""
        return np.bincount(self.scene, minlength=self.scenes) > 0

    def values(self, weights: I64) -> F64:
        """(B,) the figure of each resample."""
        return np.array([self._value(weight) for weight in weights])

    def _value(self, weight: I64) -> float:
        copies = weight[self.scene]
        ends = np.cumsum(copies)
        if not len(ends) or not ends[-1]:
            return float("nan")
        wanted = max(1, round(WORST_SHARE * int(ends[-1])))
        taken = np.clip(wanted - (ends - copies), 0, copies)
        return float(taken @ self.error) / wanted


@dataclass(frozen=True, slots=True)
class Sampled:
    """A figure on the data as they are and on every resample."""

    value: float
    draws: F64
    """(B,) NaN where a resample has no data."""
    present: Mask
    """(S,) scenes that have anything to say about it."""


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """A run's figure beside the baseline's on the same scenes."""

    key: MetricKey
    baseline: float
    value: float
    low: float
    """Ends of the 95 % interval of the difference; NaN where none can be given."""
    high: float
    scenes: int
    """How many scenes have anything to say about it."""

    @property
    def difference(self) -> float:
        """The run's figure minus the baseline's."""
        return self.value - self.baseline

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return bool(self.low > 0.0 or self.high < 0.0)

    @property
    def better(self) -> bool | None:
        """Whether the run is better than the baseline; None where that is not known."""
        if not self.significant:
            return None
        return (self.difference < 0.0) == self.key.lower_is_better


def sample(figure: Metric, weights: I64) -> Sampled:
    """Evaluates a figure on the whole and on resamples.

    Args:
        figure: of S scenes.
        weights: (B, S) how often each scene counts.
    """
    once = np.ones((1, weights.shape[1]), np.int64)
    return Sampled(float(figure.values(once)[0]), figure.values(weights), figure.present)


def paired(key: MetricKey, baseline: Sampled, run: Sampled) -> PairedDifference:
    """The difference of two runs' figures, both sampled with the same weights."""
    scenes = int(np.count_nonzero(baseline.present | run.present))
    low, high = t_interval(run.value - baseline.value, run.draws - baseline.draws, scenes)
    return PairedDifference(key, baseline.value, run.value, low, high, scenes)


def paired_all(
    baseline: Mapping[MetricKey, Sampled], run: Mapping[MetricKey, Sampled]
) -> tuple[PairedDifference, ...]:
    """The differences of every figure for which both runs have data."""
    pairs = (paired(key, side, run[key]) for key, side in baseline.items() if key in run)
    return tuple(pair for pair in pairs if pair.scenes and pair.difference == pair.difference)


def t_interval(value: float, draws: F64, scenes: int) -> tuple[float, float]:
    """Ends of the 95 % interval of a figure; NaN for fewer than two scenes.

    Args:
        value: the figure itself.
        draws: (B,) the figure on resamples; NaN where it does not exist.
        scenes: how many scenes have anything to say about it.
    """
    known = draws[~np.isnan(draws)]
    if scenes < 2 or len(known) < 2 or np.isnan(value):
        return float("nan"), float("nan")
    quantile = float(student_t.ppf(0.5 + CONFIDENCE / 2, scenes - 1))
    reach = quantile * np.sqrt(scenes / (scenes - 1)) * float(known.std())
    if reach <= ALIKE * np.abs(known).max(initial=0.0):
        reach = 0.0
    return value - reach, value + reach


def _divided(total: F64, count: F64) -> F64:
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: F64 = np.where(count > 0, total / count, np.nan)
    return ratio

"""Paired differences between runs on the same scenes, with confidence intervals.

Scenes are drawn with replacement (frames of a scene are not independent), the same ones for every
run, and every metric is evaluated again on each resample: exactly, since a scene enters as counters
that add up (`Ratio`, `Pooled`), as its sorted errors (`TailMean`), or as the profile of
the official metrics (eval/nuscenes/resampling.py).

An interval is difference +- t * sqrt(n / (n - 1)) * s with s the standard deviation over the
resamples and t the 97.5 % quantile of Student's distribution with n - 1 degrees of freedom, n the
scenes that have data for the metric. For a mean this is the textbook t interval, so its coverage
is right with few scenes too, where percentiles of the resamples are far too narrow. One scene has
no interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.eval.arithmetic import ratio
from mottrack.formats.strict_json import strict

RESAMPLES = 400
"""The standard deviation over B resamples is uncertain by 1 / sqrt(2 B), here 3.5 %: less than
matters for an interval, and a comparison still takes seconds."""
CONFIDENCE = 0.95
"""The field's usual level: about 1 in 20 null differences is reported as significant."""
WORST_SHARE = 0.05
"""The paper's "95 % largest": the share of the errors in the upper tail."""
ROUNDING_SHARE = 1e-12
"""A spread below this share of the metric is the rounding of sums (1e-16 times their length)."""


@dataclass(frozen=True, slots=True)
class MetricKey:
    """Names one metric of a run."""

    table: str
    """Such as "tracking", "velocity", "flow", "sceneflow", "runtime"."""
    row: str
    """Row of that table."""
    metric: str
    unit: str = field(default="", compare=False)
    lower_is_better: bool = field(default=True, compare=False)

    @property
    def title(self) -> str:
        """The row and the metric with its unit, as one text."""
        return f"{self.row}: {self.metric}" + (f" ({self.unit})" if self.unit else "")


class Metric(Protocol):
    """A metric of a run as a function of how often each of its S scenes counts."""

    @property
    def present(self) -> Mask:
        """(S,) the scenes that have data for it."""
        ...

    def values(self, weights: I64) -> F64:
        """Return the metric (B,) when scene s counts `weights[b, s]` times; NaN without data."""
        ...


@dataclass(frozen=True, slots=True)
class Pooled:
    """A formula of quantities that add up over scenes."""

    formula: Callable[..., F64]
    """From as many sums, (B,) each, as there are quantities; NaN where the last one is 0."""
    sums: tuple[F64, ...]
    """(S,) each; the last one counts the data."""

    @property
    def present(self) -> Mask:
        """(S,) scenes with data."""
        return self.sums[-1] > 0

    def values(self, weights: I64) -> F64:
        """Return the metric of each resample, (B,)."""
        return self.formula(*(weights @ column for column in self.sums))


@dataclass(frozen=True, slots=True)
class Ratio:
    """A mean or a share: sums over sums; its root for a root mean square."""

    total: F64
    """(S,)"""
    count: F64
    """(S,)"""
    root: bool = False

    @classmethod
    def mean(cls, parts: Sequence[F64]) -> Ratio:
        """Return the mean of the values of all scenes."""
        return cls(*_sums(parts))

    @classmethod
    def root_mean_square(cls, parts: Sequence[F64]) -> Ratio:
        """Return the root mean square of the values of all scenes."""
        return cls(*_sums([part**2 for part in parts]), root=True)

    @property
    def present(self) -> Mask:
        """(S,) scenes that count."""
        return self.count > 0

    def values(self, weights: I64) -> F64:
        """Return the metric of each resample, (B,)."""
        mean = ratio(weights @ self.total, weights @ self.count)
        return np.sqrt(mean) if self.root else mean


def _sums(parts: Sequence[F64]) -> tuple[F64, F64]:
    return np.array([p.sum() for p in parts]), np.array([float(len(p)) for p in parts])


@dataclass(frozen=True, slots=True)
class Sum:
    """A count."""

    total: F64
    """(S,)"""

    @property
    def present(self) -> Mask:
        """(S,) every scene: a count of 0 is data too."""
        return np.ones(len(self.total), np.bool_)

    def values(self, weights: I64) -> F64:
        """Return the count of each resample, (B,)."""
        return weights @ self.total


def variance(total: F64, squares: F64, count: F64) -> F64:
    """Return the population variance from sums, sums of squares and counts of values, (B,) each."""
    return np.maximum(ratio(squares, count) - ratio(total, count) ** 2, 0.0)


@dataclass(frozen=True, slots=True)
class TailMean:
    """Mean of the largest 5 % of the errors (at least one)."""

    error: F64
    """(N,) ascending: all errors, or so many of the largest that every tail lies among them."""
    scene: I64
    """(N,) of each error."""
    count: I64
    """(S,) errors of each scene, the smaller ones included."""

    @classmethod
    def of(cls, parts: Sequence[F64]) -> TailMean:
        """Sort the errors of all scenes."""
        error = np.concatenate([np.zeros(0), *parts])
        count = np.array([len(part) for part in parts], np.int64)
        scene = np.repeat(np.arange(len(parts)), count)
        order = np.argsort(error, kind="stable")
        return cls(error[order], scene[order], count)

    @property
    def present(self) -> Mask:
        """(S,) scenes with errors."""
        return self.count > 0

    def holds_tails(self, weights: I64) -> bool:
        """Return whether the errors here reach down to the end of each resample's tail."""
        here = weights @ np.bincount(self.scene, minlength=len(self.count))
        return bool((here >= [_tail(count) for count in (weights @ self.count).tolist()]).all())

    def values(self, weights: I64) -> F64:
        """Return the metric of each resample, (B,)."""
        return np.array([self._value(weight) for weight in weights])

    def _value(self, weight: I64) -> float:
        count = int(weight @ self.count)
        if not count:
            return float("nan")
        copies = weight[self.scene]
        larger = copies.sum() - np.cumsum(copies)
        return float(np.repeat(self.error, np.clip(_tail(count) - larger, 0, copies)).mean())


def _tail(count: int) -> int:
    """Return the size of the tail of so many errors; 0 without any."""
    return max(1, round(WORST_SHARE * count)) if count else 0


@dataclass(frozen=True, slots=True)
class Sampled:
    """A metric on the data as they are and on every resample."""

    value: float
    draws: F64
    """(B,) NaN where a resample has no data."""
    present: Mask
    """(S,) scenes that have data for it."""

    def interval(self) -> tuple[float, float]:
        """Return the ends of the 95 % interval of the metric; NaN where none can be given."""
        return t_interval(self.value, self.draws, int(np.count_nonzero(self.present)))


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """A run's metric beside the baseline's on the same scenes."""

    key: MetricKey
    baseline: float
    value: float
    low: float
    """Ends of the 95 % interval of the difference; NaN where none can be given."""
    high: float
    scenes: int
    """How many scenes have data for it."""

    @property
    def difference(self) -> float:
        """The run's metric minus the baseline's."""
        return self.value - self.baseline

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return bool(self.low > 0.0 or self.high < 0.0)

    @property
    def better(self) -> bool | None:
        """Whether the run is better than the baseline; None where that is not significant."""
        if not self.significant:
            return None
        return (self.difference < 0.0) == self.key.lower_is_better

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; a number that does not exist is None."""
        names = ("baseline", "value", "difference", "low", "high", "significant", "better")
        plain: dict[str, Any] = strict({n: getattr(self, n) for n in (*names, "scenes")})
        return plain


def draw(scenes: int, resamples: int, seed: int = 0) -> I64:
    """Draw scenes with replacement, as many as there are.

    Returns:
        (resamples, scenes) how often each scene is drawn.

    Raises:
        InputError: there is no scene, or no resample is asked for.
    """
    for name, count in (("scenes", scenes), ("resamples", resamples)):
        if count < 1:
            raise InputError(name, count, "at least 1")
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=resamples)
    return drawn.astype(np.int64)


def whole(metric: Metric, scenes: int = 1) -> float:
    """Return the metric of the data as they are."""
    return float(metric.values(np.ones((1, scenes), np.int64))[0])


def sample(metric: Metric, weights: I64) -> Sampled:
    """Evaluate a metric on the whole and on resamples.

    Args:
        metric: of S scenes.
        weights: (B, S) how often each scene counts.
    """
    return Sampled(whole(metric, weights.shape[1]), metric.values(weights), metric.present)


def paired(key: MetricKey, baseline: Sampled, run: Sampled) -> PairedDifference:
    """Return the difference of two runs' metrics, both sampled with the same weights."""
    scenes = int(np.count_nonzero(baseline.present | run.present))
    low, high = t_interval(run.value - baseline.value, run.draws - baseline.draws, scenes)
    return PairedDifference(key, baseline.value, run.value, low, high, scenes)


def paired_all(
    baseline: Mapping[MetricKey, Sampled], run: Mapping[MetricKey, Sampled]
) -> tuple[PairedDifference, ...]:
    """Return the differences of every metric for which both runs have data."""
    pairs = (paired(key, side, run[key]) for key, side in baseline.items() if key in run)
    return tuple(pair for pair in pairs if pair.scenes and not np.isnan(pair.difference))


def t_interval(value: float, draws: F64, scenes: int) -> tuple[float, float]:
    """Return the ends of the 95 % interval of a metric; NaN for fewer than two scenes.

    Args:
        value: the metric itself.
        draws: (B,) the metric on resamples; NaN where it does not exist.
        scenes: how many scenes have data for it.
    """
    known = draws[~np.isnan(draws)]
    if scenes < 2 or len(known) < 2 or np.isnan(value):
        return float("nan"), float("nan")
    half_width = student_quantile(scenes) * np.sqrt(scenes / (scenes - 1)) * float(known.std())
    if half_width <= ROUNDING_SHARE * np.abs(known).max(initial=0.0):
        half_width = 0.0
    return value - half_width, value + half_width


def student_interval(value: float, deviation: float, scenes: int) -> tuple[float, float]:
    """Return the ends of the 95 % interval of a figure of S scenes; NaN for fewer than two.

    `deviation` is the figure's standard deviation.
    """
    if scenes < 2 or not np.isfinite(value):
        return float("nan"), float("nan")
    half_width = student_quantile(scenes) * deviation
    return value - half_width, value + half_width


def student_quantile(scenes: int) -> float:
    """Return how many standard deviations of a mean of S scenes its 95 % interval reaches."""
    from scipy.special import stdtrit  # slow to import, and needed for intervals alone

    return float(stdtrit(scenes - 1, 0.5 + CONFIDENCE / 2))

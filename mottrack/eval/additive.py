"""Metrics that are a formula of counts which add up over sequences, for intervals over them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval import hota
from mottrack.eval.hota import HotaCounts
from mottrack.eval.identity import IdentityCounts
from mottrack.eval.paired import Sampled, sample


@dataclass(frozen=True, slots=True)
class AdditiveMetric:
    """A formula of one set of counts or of several (`eval.paired.Metric`)."""

    parts: tuple[Sequence[Any], ...]
    """Of each set the counts of every sequence: dataclasses of numbers or arrays, S each."""
    formula: Callable[..., F64]
    """From the sums of each set, whose numbers have B values and arrays B rows, to (B,)."""

    @property
    def present(self) -> Mask:
        """(S,) sequences with any count at all."""
        some = np.zeros(len(self.parts[0]), np.bool_)
        for counts in self.parts:
            some |= [any(np.any(getattr(c, f.name)) for f in fields(c)) for c in counts]
        return some

    def values(self, weights: I64) -> F64:
        """Return the metric when sequence s counts `weights[b, s]` times, (B,)."""
        return np.asarray(self.formula(*(weighted(counts, weights) for counts in self.parts)))

    @property
    def whole(self) -> float:
        """The metric of all sequences together."""
        return float(self.values(np.ones((1, len(self.parts[0])), np.int64))[0])


def weighted(counts: Sequence[Any], weights: I64) -> Any:
    """Return the sums of counts, each number (B,) and each array (B, ...).

    Args:
        counts: S dataclasses of one kind.
        weights: (B, S) how often each counts.
    """
    names = [f.name for f in fields(counts[0])]
    stacked = {n: np.array([getattr(c, n) for c in counts], np.float64) for n in names}
    return type(counts[0])(**{n: np.tensordot(weights, v, 1) for n, v in stacked.items()})


def hota_metrics(parts: Sequence[HotaCounts]) -> dict[str, AdditiveMetric]:
    """Return HOTA and its parts, means over alpha, from the counts of every sequence."""
    return {
        name: AdditiveMetric((parts,), partial(_hota_part, name))
        for name in hota.Hota.__dataclass_fields__
    }


def _hota_part(name: str, counts: HotaCounts) -> F64:
    part: F64 = getattr(hota.hota(counts), name)
    return np.asarray(part.mean(axis=-1))


def identity_metrics(parts: Sequence[IdentityCounts]) -> dict[str, AdditiveMetric]:
    """Return IDF1, IDP and IDR from the counts of every sequence."""
    return {name: property_metric(parts, name) for name in ("idf1", "idp", "idr")}


def property_metric(parts: Sequence[Any], name: str) -> AdditiveMetric:
    """Return a metric that is a property of the counts."""
    return AdditiveMetric((parts,), lambda counts: np.asarray(getattr(counts, name)))


def sampled(metrics: dict[str, AdditiveMetric], weights: I64) -> dict[str, Sampled]:
    """Return every metric on the data as they are and on resamples (B, S)."""
    return {name: sample(metric, weights) for name, metric in metrics.items()}

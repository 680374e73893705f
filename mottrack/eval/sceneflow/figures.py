"""The figures of scene flow from the sums of scenes, with intervals and paired differences."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.arithmetic import ratio
from mottrack.eval.paired import (
    MetricKey,
    PairedDifference,
    Sampled,
    paired_all,
)
from mottrack.eval.sceneflow.categories import BACKGROUND, GROUPS
from mottrack.eval.sceneflow.sums import SUMS, SceneFlowSums, total

SIDES = (("Background", "Foreground"), ("Static", "Dynamic"), ("Far", "Close"))
OFFICIAL = {"strict": "Accuracy Strict", "relaxed": "Accuracy Relax"} | {
    "angle_rad": "Angle Error",
    "epe_m": "EPE",
}
"""Names of the sums in the official output."""
HEADLINE = (
    ("official", "EPE 3-Way Average"),
    ("bucketed", "mean dynamic"),
    ("bucketed", "mean static"),
    ("threeway", "mean"),
)
"""Figures by which methods are ranked."""
COMPARED = (
    *HEADLINE,
    *(("official", f"{name}/Foreground/Dynamic") for name in OFFICIAL.values()),
    ("official", "Dynamic IoU"),
)
"""Figures by which runs are compared: many more are stored, and would hide these."""
Figures = dict[tuple[str, str], F64]
"""(table, name) to the figure on each of B resamples, (B,)."""


def _mean(values: F64, axis: int) -> F64:
    """Return the mean of what is known, NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of an empty mean
        mean: F64 = np.nanmean(values, axis=axis)
    return mean


def _official(sums: F64, motion: F64) -> dict[str, F64]:
    """Return the figures of the evaluation that `av2` ships, under its names."""
    found: dict[str, F64] = {}
    for near in (True, False):  # by distance, then of both together
        parts = sums if near else sums.sum(axis=3, keepdims=True)
        for place in product((0, 1), (0, 1), range(parts.shape[3])):
            names = [SIDES[k][i] for k, i in enumerate(place if near else place[:2])]
            if names[:2] == ["Background", "Dynamic"]:  # there is no such point
                continue
            cell = parts[:, place[0], place[1], place[2]]
            for number, key in enumerate(SUMS[1:], 1):
                found["/".join([OFFICIAL[key], *names])] = ratio(cell[:, number], cell[:, 0])
    found["Dynamic IoU"] = ratio(motion[:, 0], motion.sum(axis=1))
    three = ("Foreground/Dynamic", "Foreground/Static", "Background/Static")
    found["EPE 3-Way Average"] = sum((found[f"EPE/{n}"] for n in three), np.zeros(1)) / 3
    return found


def _bucketed(buckets: F64) -> dict[str, F64]:
    """Return static EPE (m) and dynamic error (a share of the speed) of each group, and means."""
    points, epe, speed = np.moveaxis(buckets, -1, 0)
    static = ratio(epe[:, :, 0], points[:, :, 0])
    moving = ratio(epe[:, :, 1:], points[:, :, 1:]) / ratio(speed[:, :, 1:], points[:, :, 1:])
    return _by_group(static, _mean(moving, 2))


def _by_group(static: F64, dynamic: F64) -> dict[str, F64]:
    found = {"mean static": _mean(static, 1), "mean dynamic": _mean(dynamic, 1)}
    for row, name in enumerate(GROUPS):
        found |= {f"{name} static": static[:, row], f"{name} dynamic": dynamic[:, row]}
    return found


def _threeway(threeway: F64) -> dict[str, F64]:
    """Return mean EPE (m) of static background, and static and dynamic foreground by groups."""
    background = threeway[:, BACKGROUND]
    foreground = threeway[:, BACKGROUND + 1 :].sum(axis=1)
    found = {
        "background static": ratio(background[:, 0, 1], background[:, 0, 0]),
        "foreground static": ratio(foreground[:, 0, 1], foreground[:, 0, 0]),
        "foreground dynamic": ratio(foreground[:, 1, 1], foreground[:, 1, 0]),
    }
    return {"mean": np.mean(list(found.values()), axis=0), **found}


@dataclass(frozen=True)
class SceneSums:
    """The sums of S scenes side by side."""

    scenes: tuple[SceneFlowSums, ...]

    @property
    def whole(self) -> SceneFlowSums:
        """All scenes together."""
        return total(self.scenes)

    def figures(self, weights: I64) -> Figures:
        """Return every figure when scene s counts `weights[b, s]` times, (B,) each."""
        whole = self.whole
        found: Figures = {}
        motion = self._weighted([s.motion for s in self.scenes], weights)
        official = self._weighted([s.official for s in self.scenes], weights)
        found |= {("official", n): v for n, v in _official(official, motion).items()}
        for table, figures in (("buckets", _bucketed), ("threeway", _threeway)):
            if getattr(whole, table) is None:
                continue
            sums = self._weighted([getattr(s, table) for s in self.scenes], weights)
            name = "bucketed" if table == "buckets" else table
            found |= {(name, key): value for key, value in figures(sums).items()}
        none = np.zeros(len(SUMS))
        for row in whole.rows:
            sums = self._weighted([s.rows.get(row, none) for s in self.scenes], weights)
            found |= {(row, k): ratio(sums[:, i], sums[:, 0]) for i, k in enumerate(SUMS) if i}
        return found

    @staticmethod
    def _weighted(parts: Sequence[F64], weights: I64) -> F64:
        return np.tensordot(weights.astype(np.float64), np.stack(parts), axes=1)

    def values(self) -> dict[tuple[str, str], float]:
        """Return every figure of all scenes; NaN where there is no point for it."""
        once = np.ones((1, len(self.scenes)), np.int64)
        return {key: float(value[0]) for key, value in self.figures(once).items()}

    def sampled(self, weights: I64) -> dict[MetricKey, Sampled]:
        """Return every figure with its values on resamples of the scenes."""
        draws, values = self.figures(weights), self.values()
        alone = self.figures(np.eye(len(self.scenes), dtype=np.int64))
        return {
            key_of(*key): Sampled(value, draws[key], ~np.isnan(alone[key]))
            for key, value in values.items()
        }

    def present(self) -> Mask:
        """(S,) scenes with any point that counts."""
        return np.array([s.official[..., 0].sum() > 0 for s in self.scenes])


def key_of(table: str, name: str) -> MetricKey:
    """Return the key of a figure: accuracies and IoU are better when higher, errors when lower."""
    accurate = name in ("strict", "relaxed") or name.startswith(("Accuracy", "Dynamic IoU"))
    unit = "" if accurate or "dynamic" in name else ("rad" if "ngle" in name else "m")
    return MetricKey("sceneflow", table, name, unit, lower_is_better=not accurate)


def differences(
    baseline: Mapping[MetricKey, Sampled], run: Mapping[MetricKey, Sampled]
) -> tuple[PairedDifference, ...]:
    """Return the paired differences of two methods on the same scenes and resamples."""
    return paired_all(baseline, run)

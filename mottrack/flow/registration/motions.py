"""The motion of each component over several past sweeps, its covariance and its probability.

A component is registered to each past sweep, from the claim of an estimator. At 1 m/s a tenth of a
second is a fifth of a cell, half a second a whole one: longer baselines measure slow motion, and
average the noise of fast ones. The claim and the registrations are then fused by their covariances
with weights that fall for what disagrees with the rest (a registration that slid along a wall).

Whether it moves at all is judged by what the motion explains better than rest, point by point:
there the noise of the sensor and the gaps between its rings, which are in both distances, drop out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.flow.registration.kernels import MatchScene
from mottrack.flow.registration.matcher import CurrentPoints, Labels, SortedPoints
from mottrack.flow.registration.motion_fit import FitLimits, fit_motions, motion_evidence
from mottrack.flow.sweep_pair import PastSweep

MIN_POINTS = 6
"""Fewer points fit any shift: they are not registered."""
_SIGMA_M = 0.02
"""Noise of a registration that fits perfectly: the noise of a range."""
_COST_SHARE = 0.5
"""Standard deviation of one coordinate of a shift, as a share of its remaining cost: 0.4 to 0.6
over all sizes of components of the recorded drives and the embedded world."""
_WELL_SHAPED = 1.0
"""Curvature in 1/m above which the error does not fall further; below, it grows as its root: the
side of a truck slides along itself."""
_LEAST_CURVATURE = 0.2
"""What of a cost hardly rises is noise of the cost."""
_ACCELERATION_MPS2 = 1.5
"""Standard deviation of a vehicle's acceleration: a longer baseline measures an older velocity."""
_CLAIM_FLOOR_MPS = 0.01
"""No estimator is more certain than that, and its covariance stays invertible."""
_OUTLIER_SIGMAS = 2.0
"""Distance from the others, in standard deviations, at which an estimate's weight is halved."""
_PRIOR_FREEDOM = 4.0
"""Degrees of freedom that the stated covariances are worth: two estimates of a plane velocity. With
it mean d^2 / 2 lies between 0.7 and 2 on every recorded drive."""
_OF_CELLS, _SPREAD_SHARE = 1.05, 0.05
"""The covariance of a cell is that of its component so many times, and this share of the squared
spread of the claims inside it: what is several objects, or turns, has several velocities. With the
two of the world and two drives 81 to 91 % of the third drive's cells lie within the second contour,
and mean d^2 / 2 is 0.75 to 1.4."""
_HOPELESS = 0.1
"""Probability of moving, by the claim and the newest past sweep, below which no registration is
tried: of 130 slow components that move, on two recorded drives and a scene of the world, two have
less, and of 2500 others one."""
_ITERATIONS = 6
"""Steps of the reweighting: it starts from the part that agrees best, so a few do."""
_AGREES_MPS, _AGREES_SHARE = 1.5, 0.3
"""A registration within this of the claim is the start of the next one; others slid away."""
_FARTHEST = np.array([-6.0, 12.0])
"""Of a significance more is not more certain: the distances of neighbouring points are alike."""
_LEAST_SPEED_MPS, _FAST_MPS = 0.1, 2.0
"""Between them a faster claim is more often right; beyond, those of shadows are as fast."""
_LEAST_COST_M = 0.02
"""Below the noise of a range a ratio of costs means nothing."""
_LEAST_RATIO = 0.1
"""A motion that leaves a tenth of the cost explains everything."""
_FEW_POINTS = 5.0
"""Points of a component whose ratio counts half: two or three fit nothing for certain. The same to
a tenth of the likelihood's gain from 2 to 10."""


class OddsWeights(NamedTuple):
    """Logistic regression: log odds that a claimed component moves."""

    constant: float
    significance: float
    """For the mean significance over the past sweeps."""
    ratio: float
    """For the logarithm of the mean ratio of the cost of the motion to that of rest, which counts
    less where the points are few."""
    speed: float
    """For the logarithm of the fused speed, up to `_FAST_MPS`."""


ODDS = OddsWeights(-1.22, 0.18, -4.33, 1.1)
"""Fitted to the components of three recorded drives and eight scenes of the embedded world, with
one to three past sweeps. `benchmarks/flow_evidence.py` fits them again and judges them on each
drive left out."""


@dataclass(frozen=True, slots=True)
class Claims:
    """What an estimator says of K components."""

    velocity_mps: F64
    """(K, 2)."""
    covariance_m2ps2: F64
    """(K, 2, 2)."""
    spread_mps: F64
    """(K,) root mean square distance of the velocities of its cells from that of the component."""


@dataclass(frozen=True, slots=True)
class ComponentMotions:
    """The motions of K components."""

    velocity_mps: F64
    """(K, 2) of the centre, if the component moves."""
    covariance_m2ps2: F64
    """(K, 2, 2) of its error."""
    turn_radps: F64
    """(K,) rate of rotation about the centre."""
    centre_m: F64
    """(K, 2)."""
    points: I64
    """(K,) thinned points."""
    evidence: F64
    """(K, 3) the numbers that `ODDS` weighs, in its order."""
    p_moving: F64
    """(K,) probability that the component moves."""

    @property
    def judged(self) -> Mask:
        """(K,) components that a past sweep could see, at rest or moved."""
        judged: Mask = (self.evidence[:, :2] != 0).any(axis=1)
        return judged

    def velocities_mps(self, component: I64, xy_m: F64) -> F64:
        """Return (C, 2) velocities of places (C, 2) on components (C,)."""
        dx, dy = (xy_m - self.centre_m[component]).T
        turn = self.turn_radps[component][:, None]
        velocity: F64 = self.velocity_mps[component] + turn * np.column_stack([-dy, dx])
        return velocity


class _Fit(NamedTuple):
    """Registration of K components to one past sweep."""

    elapsed_s: float
    velocity_mps: F64
    covariance_m2ps2: F64
    turn_radps: F64
    centre_m: F64
    usable: Mask


def component_motions(
    current: CurrentPoints, past: Sequence[PastSweep], labels: Labels, claims: Claims
) -> ComponentMotions:
    """Return the motions of components, registered to each past sweep from the claims.

    Args:
        current: the current sweep.
        past: the past sweeps to register to; the first is the one that the claims are of.
        labels: the components.
        claims: of the estimator.
    """
    sorted_points = current.sorted(labels)
    scenes = [current.scene(sweep, sorted_points.footprint) for sweep in past]
    compared = _Compared(scenes, sorted_points, current.config.max_points)
    nowhere = np.zeros((labels.count, 3))
    claimed = np.column_stack([-past[0].elapsed_s * claims.velocity_mps, nowhere])
    everything = np.ones(labels.count, np.bool_)
    first = _evidence(compared, [claimed], everything, claims.velocity_mps)
    wanted = _probability(first) > _HOPELESS
    start_mps, turn_radps = claims.velocity_mps, np.zeros(labels.count)
    fits: list[_Fit] = []
    for sweep, scene in zip(past, scenes, strict=True):
        starts = -sweep.elapsed_s * np.column_stack([start_mps, turn_radps])
        limits = FitLimits(
            current.config.max_points, current.config.max_turn_radps * sweep.elapsed_s, MIN_POINTS
        )
        rows = fit_motions(scene, sorted_points.components, starts, wanted, limits)
        fits.append(_fit(rows, sweep.elapsed_s))
        start_mps, turn_radps = _next_start(claims.velocity_mps, start_mps, turn_radps, fits[-1])
    fusion = _fused(claims, fits)
    turn_radps = _fused_turn(fits, fusion.weights[:, 1:])
    moved = [
        np.column_stack(
            [-fit.elapsed_s * fusion.velocity_mps, -fit.elapsed_s * turn_radps, fit.centre_m]
        )
        for fit in fits
    ]
    last = _evidence(compared, moved, wanted, fusion.velocity_mps)
    evidence = np.where(wanted[:, None], last, first)
    return ComponentMotions(
        velocity_mps=fusion.velocity_mps,
        covariance_m2ps2=_of_cells(fusion.covariance_m2ps2, claims.spread_mps),
        turn_radps=turn_radps,
        centre_m=fits[0].centre_m,
        points=np.diff(sorted_points.components.spans),
        evidence=evidence,
        p_moving=_probability(evidence),
    )


def _probability(evidence: F64) -> F64:
    """Return (K,) the probability that each component moves, from its evidence (K, 3)."""
    p: F64 = 1.0 / (1.0 + np.exp(-ODDS.constant - evidence @ np.array(ODDS[1:])))
    return p


def _fit(rows: F64, elapsed_s: float) -> _Fit:
    """Return the rows (K, 9) of `fit_motions` as velocities with a covariance."""
    usable = np.isfinite(rows[:, 5])
    curvature = rows[:, [6, 7, 7, 8]].reshape(-1, 2, 2)
    eigen, axes = np.linalg.eigh(np.where(usable[:, None, None], curvature, np.eye(2)))
    shape = np.maximum(_WELL_SHAPED / np.maximum(eigen, _LEAST_CURVATURE), 1.0)
    sigma_m = np.hypot(_SIGMA_M, _COST_SHARE * np.nan_to_num(rows[:, 5]))
    variance = (sigma_m**2)[:, None] * shape / elapsed_s**2
    variance = variance + (0.5 * _ACCELERATION_MPS2 * elapsed_s) ** 2
    return _Fit(
        elapsed_s=elapsed_s,
        velocity_mps=-rows[:, :2] / elapsed_s,
        covariance_m2ps2=np.einsum("kij,kj,klj->kil", axes, variance, axes),
        turn_radps=-rows[:, 2] / elapsed_s,
        centre_m=rows[:, 3:5],
        usable=usable,
    )


def _next_start(claimed_mps: F64, start_mps: F64, turn_radps: F64, fit: _Fit) -> tuple[F64, F64]:
    """Return velocities (K, 2) and rates (K,) from which the next past sweep is registered."""
    limit_mps = _AGREES_MPS + _AGREES_SHARE * np.hypot(*claimed_mps.T)
    agrees = fit.usable & (np.hypot(*(fit.velocity_mps - claimed_mps).T) < limit_mps)
    return (
        np.where(agrees[:, None], fit.velocity_mps, start_mps),
        np.where(agrees, fit.turn_radps, turn_radps),
    )


class _Fusion(NamedTuple):
    """Fused velocities of K components from 1 + B parts: the claim and the registrations."""

    velocity_mps: F64
    """(K, 2)."""
    covariance_m2ps2: F64
    """(K, 2, 2)."""
    weights: F64
    """(K, 1 + B) in [0, 1]."""


def _fused(claims: Claims, fits: Sequence[_Fit]) -> _Fusion:
    """Return the M-estimate with Cauchy weights, from the part that agrees best with all others.

    The covariance of the parts is known up to the drive, the sensor and the object: how far they
    lie apart tells more of it, with the weight of its degrees of freedom.
    """
    parts = np.stack([claims.velocity_mps, *(fit.velocity_mps for fit in fits)], axis=1)
    floor = _CLAIM_FLOOR_MPS**2 * np.eye(2)
    covariance = np.stack(
        [claims.covariance_m2ps2 + floor, *(fit.covariance_m2ps2 for fit in fits)], axis=1
    )
    usable = np.column_stack([np.ones(len(parts), np.bool_), *(fit.usable for fit in fits)])
    information = np.linalg.inv(covariance) * usable[:, :, None, None]
    between = np.linalg.inv(covariance[:, :, None] + covariance[:, None])
    apart = parts[:, :, None] - parts[:, None]
    squared = np.einsum("kija,kijab,kijb->kij", apart, between, apart)
    disagreement = (np.log1p(squared / _OUTLIER_SIGMAS**2) * usable[:, None]).sum(axis=2)
    best = np.where(usable, disagreement, np.inf).argmin(axis=1)
    velocity_mps = parts[np.arange(len(parts)), best]
    weights = usable.astype(np.float64)
    total = information.sum(axis=1)
    for _ in range(_ITERATIONS):
        apart = parts - velocity_mps[:, None]
        squared = np.einsum("kia,kiab,kib->ki", apart, information, apart)
        weights = usable / (1.0 + squared / _OUTLIER_SIGMAS**2)
        total = np.einsum("ki,kiab->kab", weights, information)
        pull = np.einsum("ki,kiab,kib->ka", weights, information, parts)
        velocity_mps = np.linalg.solve(total, pull[..., None])[..., 0]
    apart = parts - velocity_mps[:, None]
    squared = np.einsum("kia,kiab,kib->ki", apart, information, apart)
    halved = _OUTLIER_SIGMAS**2
    spread = (usable * halved * np.log1p(squared / halved)).sum(axis=1)
    freedom = 2.0 * (usable.sum(axis=1) - 1)
    scale = (_PRIOR_FREEDOM + spread) / (_PRIOR_FREEDOM + freedom)
    covariance = scale[:, None, None] * np.linalg.inv(total)
    return _Fusion(velocity_mps, covariance, weights)


def _of_cells(covariance_m2ps2: F64, spread_mps: F64) -> F64:
    """Return the covariances (K, 2, 2) of the cells of components, of those of the centres."""
    apart = _SPREAD_SHARE * np.square(spread_mps)[:, None, None] * np.eye(2)
    return _OF_CELLS * covariance_m2ps2 + apart


def _fused_turn(fits: Sequence[_Fit], weights: F64) -> F64:
    """Return (K,) rates of rotation: a longer baseline measures them better, as its square."""
    weight = weights * np.array([fit.elapsed_s**2 for fit in fits])
    turn = np.column_stack([fit.turn_radps for fit in fits])
    total = weight.sum(axis=1)
    mean: F64 = (weight * turn).sum(axis=1) / np.where(total > 0, total, 1.0)
    return mean


class _Compared(NamedTuple):
    """What motions are compared on."""

    scenes: Sequence[MatchScene]
    points: SortedPoints
    most: int
    """Points of a component."""


def _evidence(compared: _Compared, motions: Sequence[F64], wanted: Mask, fused_mps: F64) -> F64:
    """Return (K, 3) the evidence of `motions`, (K, 5) for each scene, of velocities (K, 2)."""
    components, parts = compared.points.components, []
    for scene, motion in zip(compared.scenes, motions, strict=False):
        rows = motion_evidence(scene, components, motion, wanted, compared.most)
        ratio = rows[:, 1] / np.maximum(rows[:, 2], _LEAST_COST_M)
        parts.append(np.column_stack([np.clip(rows[:, 0], *_FARTHEST), ratio]))
    mean: F64 = np.nan_to_num(np.mean(parts, axis=0))
    points = np.diff(components.spans)
    mean[:, 1] = np.log(np.maximum(mean[:, 1], _LEAST_RATIO)) * points / (points + _FEW_POINTS)
    speed_mps = np.minimum(np.hypot(*fused_mps.T), _FAST_MPS)
    return np.column_stack([mean, np.log(speed_mps + _LEAST_SPEED_MPS)])

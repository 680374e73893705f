"""Interacting multiple models (Blom and Bar-Shalom, 1988), batched over all tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.dense_bank import DenseBank
from mottrack.trackers.kalman.pair_cost import heading_residual
from mottrack.trackers.kalman.state import BOX_SIZE, PLANAR, VELOCITY, YAW

LEAST_PROBABILITY = 1e-6
CALM = 0.1
"""Share of the noise on the velocity that a model keeps among others: they explain the rest."""
JUDGED = [0, 1, YAW]
"""The models differ in x, y and the heading: those judge between them."""


class ImmBank:
    """N tracks, each with one filter for every model it may follow, and the models' probabilities.

    `models` are the names of all models, `choices` says which of them each kind of motion may
    follow, (kinds, K), and `switch_per_s` is the rate at which objects change their model.
    """

    def __init__(
        self,
        models: Sequence[str],
        choices: Mask,
        switch_per_s: float,
        *,
        wiener: bool,
    ) -> None:
        self._banks = [DenseBank([name], wiener=wiener) for name in models]
        size = max(bank.size for bank in self._banks)
        for bank in self._banks:
            bank.resize(size)
        self.size = size
        self._choices = choices
        self._switch_per_s = switch_per_s
        self._kind: I64 = np.empty(0, np.int64)
        self.probability: F64 = np.empty((0, len(models)))

    def __len__(self) -> int:
        return len(self.probability)

    @property
    def mean(self) -> F64:
        """(N, D) mean over the models; headings are averaged about the likeliest one."""
        return _mixed_mean(self.probability, self._means())

    @property
    def covariance(self) -> F64:
        """(N, D, D) covariance over the models, with the spread of their means."""
        return _mixed_covariance(self.probability, self._means(), self._covariances(), self.mean)

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        return self.covariance[:, np.array(PLANAR)[:, None], PLANAR]

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        return np.diagonal(self.covariance, axis1=1, axis2=2)[:, 2:7]

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks; `model` (n,) is the kind of motion, a row of `choices`."""
        for bank in self._banks:
            bank.append(mean, variance, velocity_covariance, np.zeros(len(mean), np.int64))
        allowed = self._choices[model].astype(float)
        self._kind = np.append(self._kind, model)
        self.probability = np.concatenate(
            [self.probability, allowed / allowed.sum(axis=1, keepdims=True)]
        )

    def keep(self, mask: Mask) -> None:
        """Drops every track outside the mask (N,)."""
        for bank in self._banks:
            bank.keep(mask)
        self._kind, self.probability = self._kind[mask], self.probability[mask]

    def predict(self, dt_s: F64, process: F64) -> None:
        """Mixes the models' estimates by the chance of a switch, then advances each model."""
        transition = self._transition(dt_s)
        joint = self.probability[:, :, None] * transition
        after = joint.sum(axis=1)
        weight = joint / np.maximum(after, LEAST_PROBABILITY**2)[:, None, :]
        means, covariances = self._means(), self._covariances()
        mixes = self._choices[self._kind].sum(axis=1) > 1
        calm = process.copy()
        calm[mixes, 7:9] *= CALM
        for k, bank in enumerate(self._banks):
            used = np.where(after[:, k, None] > 0, weight[:, :, k], np.eye(len(self._banks))[k])
            bank.mean = _mixed_mean(used, means)
            bank.covariance = _mixed_covariance(used, means, covariances, bank.mean)
            bank.predict(dt_s, calm)
        self.probability = after

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        for bank in self._banks:
            bank.turn(rows)

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects every model of `rows` (n,), and the models' probabilities by their surprise."""
        combined, evidence = self.mean[rows, :BOX_SIZE], []
        for bank in self._banks:
            own = residual + combined - bank.mean[rows, :BOX_SIZE]
            own[:, YAW] = heading_residual(own[:, YAW])
            noise = np.zeros((len(rows), 3, 3))
            noise[:, :2, :2], noise[:, 2, 2] = position, axial[:, 1]
            spread = bank.covariance[rows][:, np.array(JUDGED)[:, None], JUDGED] + noise
            evidence.append(_log_likelihood(own[:, JUDGED], spread))
            bank.update_box(rows, own, position, axial)
        self._judge(rows, np.stack(evidence, axis=1))

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects every model of `rows` (n,) by velocity residuals (n, 2)."""
        combined, evidence = self.mean[rows, VELOCITY], []
        for bank in self._banks:
            own = residual + combined - bank.mean[rows, VELOCITY]
            spread = bank.covariance[rows][:, VELOCITY, VELOCITY] + covariance
            evidence.append(_log_likelihood(own, spread))
            bank.update_velocity(rows, own, covariance)
        self._judge(rows, np.stack(evidence, axis=1))

    def _judge(self, rows: I64, evidence: F64) -> None:
        """Bayes over the models: mu_k <- mu_k L_k, kept off zero so that none is ever ruled out."""
        allowed = self._choices[self._kind[rows]]
        best = np.where(allowed, evidence, -np.inf).max(axis=1, keepdims=True)
        posterior = self.probability[rows] * np.exp(np.minimum(evidence - best, 0.0))
        posterior = np.where(allowed, np.maximum(posterior, LEAST_PROBABILITY), 0.0)
        self.probability[rows] = posterior / posterior.sum(axis=1, keepdims=True)

    def _transition(self, dt_s: F64) -> F64:
        """(N, K, K) chance to go from model i to model j, among those a track may follow."""
        allowed = self._choices[self._kind].astype(float)
        share = allowed / allowed.sum(axis=1, keepdims=True)
        stay = np.exp(-self._switch_per_s * dt_s)[:, None, None]
        return np.asarray(stay * np.eye(len(self._banks)) + (1.0 - stay) * share[:, None, :])

    def _means(self) -> F64:
        return np.stack([bank.mean for bank in self._banks], axis=1)

    def _covariances(self) -> F64:
        return np.stack([bank.covariance for bank in self._banks], axis=1)


def _mixed_mean(weight: F64, means: F64) -> F64:
    """Weighted mean (N, D) of means (N, K, D), headings about that of the greatest weight."""
    rows = np.arange(len(means))
    centre = means[rows, weight.argmax(axis=1)][:, None, :]
    offset = means - centre
    offset[:, :, YAW] = wrap_angle(offset[:, :, YAW])
    mixed = centre[:, 0] + np.einsum("nk,nkd->nd", weight, offset)
    mixed[:, YAW] = wrap_angle(mixed[:, YAW])
    return np.asarray(mixed)


def _mixed_covariance(weight: F64, means: F64, covariances: F64, centre: F64) -> F64:
    offset = means - centre[:, None, :]
    offset[:, :, YAW] = wrap_angle(offset[:, :, YAW])
    spread = covariances + offset[:, :, :, None] * offset[:, :, None, :]
    return np.asarray(np.einsum("nk,nkij->nij", weight, spread))


def _log_likelihood(residual: F64, spread: F64) -> F64:
    solved = np.linalg.solve(spread, residual[:, :, None])[:, :, 0]
    return np.asarray(
        -0.5 * (np.einsum("nd,nd->n", residual, solved) + np.linalg.slogdet(spread)[1])
    )

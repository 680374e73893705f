"""GTSAM engine: one factor graph per frame for all tracks, eliminated with QR.

Per track the graph holds the root of its chain (what is known of the newest state), the motion
factor to the new state and the factors of the new measurements. Eliminating the old state leaves
its conditional in the Bayes net and the new root among the remaining factors. GTSAM's own fixed-lag
smoothers do the same work several times slower when driven from Python, one object or one
relinearisation at a time (`benchmarks/fixed_lag.py`).
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import gtsam
import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.fixed_lag.config import MotionModelConfig
from mottrack.trackers.fixed_lag.engine import FixedLagEngine, Recent
from mottrack.trackers.fixed_lag.nodes import NodeBatch, WhitenedRows, whiten

_INDEX_BITS = 24
"""Bits of a GTSAM key that number the nodes of a track: 19 days at 10 Hz. The rest is the slot."""
_NEAR_VARIABLE = re.compile(r"near variable\s+(\d+)")
_UNIT = {rows: gtsam.noiseModel.Unit.Create(rows) for rows in (2, 6, 8, 10, 14, 16)}
"""Unit noise by dimension, made once: without a model, `add` takes twice as long."""


class Eliminated(NamedTuple):
    """Outcome of one elimination; births have no old state."""

    conditionals: list[Any]
    """`p(x_k | x_k+1)` of the old states."""
    roots: list[Any]
    """Factors with what is known of the new states."""


class StackedRows(NamedTuple):
    """Whitened rows of N tracks, the root of the chain first."""

    previous: F64
    """(N, 16, 6) coefficients of the old state."""
    current: F64
    """(N, 16, 6) coefficients of the new state."""
    target: F64
    """(N, 16)."""


class GtsamEngine(FixedLagEngine[WhitenedRows]):
    """Fixed-lag smoothing by forward elimination of a chain per track."""

    def __init__(
        self, model: MotionModelConfig, lag_ns: int, separate_factors: bool = False
    ) -> None:
        """Make root, motion, position and velocity factors of their own if `separate_factors`.

        Otherwise one factor per track stacks their rows, which is the same graph and faster.
        """
        layout = {
            "number": (np.int64, ()),  # counted from the birth; a part of GTSAM's key
            "root": (np.float64, (6, 7)),  # [R d] of p(x_k), given measurements up to k
            "conditional": (np.object_, ()),  # p(x_k | x_k+1); stale at the newest node
        }
        super().__init__(model, lag_ns, layout)
        self._add = _add_separate if separate_factors else _add_stacked
        self._eliminate = _eliminate_both if separate_factors else _eliminate_old

    def _prepare(self, batch: NodeBatch, anchor_m: F64, dt_s: F64) -> WhitenedRows:
        return whiten(batch, anchor_m, dt_s, self.model)

    def _advance(self, nodes: WhitenedRows, slots: I64, column: I64) -> Mask:
        previous = self.store.before(column)
        number = np.where(nodes.birth, 0, self.store["number"][slots, previous] + 1)
        keys = (slots << _INDEX_BITS) + number
        good = np.ones(len(slots), np.bool_)
        while good.any():
            roots = self.store["root"][slots[good], previous[good]]
            graph = self._frame_graph(nodes.select(good), roots, keys[good])
            try:
                found = self._eliminate(graph, keys[good], nodes.birth[good])
            except RuntimeError as failure:
                good &= slots != _failed_slot(failure, slots[good])
                continue
            roots = _roots(found.roots, keys[good])
            mean, covariance, valid = _moments(roots)
            if valid.all():
                break
            good[good] = valid
        else:
            return good
        old, kept = good & ~nodes.birth, slots[good]
        self.store["conditional"][slots[old], previous[old]] = found.conditionals
        self.store["root"][kept, column[good]] = roots
        self.store["number"][kept, column[good]] = number[good]
        self._mean[kept], self._covariance[kept] = mean, covariance
        return good

    def _frame_graph(self, nodes: WhitenedRows, roots: F64, keys: I64) -> Any:
        """Return the graph of nodes (N,) with their new keys, and the roots that they continue."""
        graph = gtsam.GaussianFactorGraph()
        births, counts = nodes.birth.tolist(), nodes.count.tolist()
        stacked = _stacked_rows(roots, nodes)
        for row, key in enumerate(keys.tolist()):
            count = counts[row]
            if births[row]:
                current, target = nodes.current[row, :count], nodes.target[row, :count]
                graph.add(key, current, target, _UNIT[count])
            else:
                self._add(graph, key, stacked, row, count + 6)
        return graph

    def smoothed(self, recent: Recent) -> F64:
        """Return means (N, D, 6) by back-substitution through the Bayes net of the conditionals."""
        net, keys = gtsam.GaussianBayesNet(), []
        numbers = (recent.slots << _INDEX_BITS)[:, None] + self.store["number"][
            recent.slots[:, None], recent.column
        ]
        roots = self.store["root"][recent.slots, recent.column[:, -1]]
        for row, slot in enumerate(recent.slots.tolist()):
            there = recent.there[row]
            for conditional in self.store["conditional"][slot, recent.column[row, there][:-1]]:
                net.push_back(conditional)
            own = numbers[row, there].tolist()
            net.push_back(gtsam.GaussianConditional(own[-1], roots[row, :, 6], roots[row, :, :6]))
            keys += own
        mean = np.zeros((*recent.column.shape, 6))
        mean[recent.there] = net.optimize().vector(keys).reshape(-1, 6)
        return mean

    def _smoothed_covariance(self, slot: int, column: I64) -> F64:
        """Substitute backwards: `R x_k + S x_k+1 = d`, so `P_k = R^-1 R^-T + L P_k+1 L^T`."""
        spread = np.empty((len(column), 6, 6))
        spread[-1] = self._covariance[slot]
        for k in range(len(column) - 2, -1, -1):
            jacobian = self.store["conditional"][slot, column[k]].augmentedJacobianUnweighted()
            inverse = np.linalg.inv(jacobian[:, :6])
            gain = inverse @ jacobian[:, 6:12]
            spread[k] = inverse @ inverse.T + gain @ spread[k + 1] @ gain.T
        return spread


def _stacked_rows(roots: F64, rows: WhitenedRows) -> StackedRows:
    previous = np.concatenate([roots[:, :, :6], rows.previous], axis=1)
    current = np.concatenate([np.zeros_like(roots[:, :, :6]), rows.current], axis=1)
    return StackedRows(previous, current, np.concatenate([roots[:, :, 6], rows.target], axis=1))


def _add_stacked(graph: Any, key: int, rows: StackedRows, row: int, count: int) -> None:
    """Add the first `count` rows of a track as one factor: root, motion and measurements."""
    old, new = rows.previous[row, :count], rows.current[row, :count]
    graph.add(key - 1, old, key, new, rows.target[row, :count], _UNIT[count])


def _add_separate(graph: Any, key: int, rows: StackedRows, row: int, count: int) -> None:
    """Add root, motion, position and velocity as factors of their own."""
    previous, current, target = rows.previous[row], rows.current[row], rows.target[row]
    graph.add(key - 1, previous[:6], target[:6], _UNIT[6])
    graph.add(key - 1, previous[6:12], key, current[6:12], target[6:12], _UNIT[6])
    for first in range(12, count, 2):
        graph.add(key, current[first : first + 2], target[first : first + 2], _UNIT[2])


def _eliminate_old(graph: Any, keys: I64, birth: Mask) -> Eliminated:
    """Eliminate old states alone: what remains of a stacked factor is the new root.

    QR: Cholesky rejects healthy tracks whose motion noise is small.
    """
    order = gtsam.Ordering(np.where(birth, keys, keys - 1).tolist())
    net, rest = graph.eliminatePartialSequential(order, gtsam.EliminateQR)
    survivors = iter(range(rest.size()))
    births = birth.tolist()
    roots = [net.at(k) if born else rest.at(next(survivors)) for k, born in enumerate(births)]
    return Eliminated([net.at(k) for k, born in enumerate(births) if not born], roots)


def _eliminate_both(graph: Any, keys: I64, birth: Mask) -> Eliminated:
    """Eliminate old and new states, which joins the factors of a new state as well."""
    new = keys.tolist()
    pairs = [[key] if born else [key - 1, key] for key, born in zip(new, birth, strict=True)]
    order = gtsam.Ordering([key for pair in pairs for key in pair])
    net = graph.eliminateSequential(order, gtsam.EliminateQR)
    last = np.cumsum(np.where(birth, 1, 2)) - 1
    conditionals = [net.at(position - 1) for position in last[~birth].tolist()]
    return Eliminated(conditionals, [net.at(position) for position in last.tolist()])


def _roots(factors: list[Any], keys: I64) -> F64:
    """Return `[R d]` (N, 6, 7) of the new states; NaN where one is not determined.

    Raises:
        RuntimeError: the elimination has lost the order of the tracks.
    """
    roots = np.full((len(keys), 6, 7), np.nan)
    for row, (factor, key) in enumerate(zip(factors, keys.tolist(), strict=True)):
        if factor.keys()[0] != key:
            raise RuntimeError(f"elimination order changed near key {key}")
        jacobian = factor.augmentedJacobianUnweighted()
        if jacobian.shape == (6, 7):
            roots[row] = jacobian
    return roots


def _failed_slot(failure: RuntimeError, slots: I64) -> int:
    """Return the slot, among those eliminated, of the failed track; re-raise if it names none."""
    match = _NEAR_VARIABLE.search(str(failure))
    slot = int(match.group(1)) >> _INDEX_BITS if match else -1
    if slot not in slots:
        raise failure
    return slot


@compiled
def _moments(roots: F64) -> tuple[F64, F64, Mask]:
    """Return mean (N, 6), covariance (N, 6, 6) and validity (N,) of roots `R x = d`."""
    count = len(roots)
    mean, covariance = np.zeros((count, 6)), np.zeros((count, 6, 6))
    valid = np.zeros(count, np.bool_)
    inverse = np.zeros((6, 6))
    for n in range(count):
        if not _invert_triangular(roots[n], inverse):
            continue
        valid[n] = True
        for i in range(6):
            mean[n, i] = _dot(inverse[i], roots[n, :, 6])
            for j in range(6):
                covariance[n, i, j] = _dot(inverse[i], inverse[j])
            # a variance of 1e12: the state is not determined
            valid[n] &= np.isfinite(mean[n, i]) and covariance[n, i, i] < 1e12
    return mean, covariance, valid


@compiled
def _invert_triangular(root: F64, inverse: F64) -> bool:
    """Write the inverse of the upper triangle of `root` (6, 6+); return whether there is one."""
    for column in range(6):
        # a standard deviation of 1e9 or more is singular; the comparison is false for NaN as well
        if not abs(root[column, column]) > 1e-9:
            return False
        inverse[column, column] = 1.0 / root[column, column]
        for row in range(column - 1, -1, -1):
            total = _dot(root[row, row + 1 : column + 1], inverse[row + 1 : column + 1, column])
            inverse[row, column] = -total / root[row, row]
    return True


@compiled
def _dot(one: F64, other: F64) -> float:
    total = 0.0
    for k in range(len(one)):
        total += one[k] * other[k]
    return total

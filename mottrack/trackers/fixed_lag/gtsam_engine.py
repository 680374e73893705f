"""The engine on GTSAM: one factor graph a frame for all tracks, eliminated with QR.

Per track the graph holds the root of its chain (what is known of the newest state), the motion
factor to the new state and the factors of the new measurements. Eliminating old before new leaves
the old state's conditional and the new root. GTSAM's own fixed-lag smoothers do the same work 6 to
50 times slower when driven from Python, one object or one relinearisation at a time.
"""

from __future__ import annotations

import re
from collections import deque
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from mottrack.trackers.fixed_lag.engine import FixedLagEngine, Node, stacked
from mottrack.trackers.fixed_lag.motion import F64, MotionNoise
from mottrack.trackers.fixed_lag.nodes import NodeBatch, WhitenedRows, whiten

_INDEX_BITS = 24
_NEAR_VARIABLE = re.compile(r"near variable\s+(\d+)")


class _Chain:
    """Eliminated states of one track, oldest first."""

    __slots__ = ("conditionals", "count", "roots")

    def __init__(self) -> None:
        self.conditionals: deque[Any] = deque()
        """p(x_k | x_k+1) of every state but the newest."""
        self.roots: deque[Any] = deque()
        """p(x_k) given measurements up to k; None where a change of weights made it stale."""
        self.count = 0
        """States ever made; the newest has the key of `count - 1`."""


class GtsamEngine(FixedLagEngine):
    """Fixed-lag smoothing by forward elimination of a chain per track."""

    def __init__(self, noise: MotionNoise, lag_ns: int, separate_factors: bool = False) -> None:
        """With `separate_factors`, motion, position and velocity are three factors (the paper).

        Otherwise one factor stacks their rows, which is the same graph and faster.
        """
        super().__init__(noise, lag_ns)
        self._separate = separate_factors
        self._chains: dict[int, _Chain] = {}

    def _advance(self, batch: NodeBatch, dt_s: F64) -> NDArray[np.bool_]:
        rows = whiten(batch, self._anchor_m[batch.slot], dt_s, self.noise)
        good = np.ones(len(batch), np.bool_)
        while good.any():
            graph, keys = self._frame_graph(batch, rows, good)
            try:
                net = _eliminate(graph, keys)
            except RuntimeError as failure:
                good &= batch.slot != _culprit(failure, batch.slot[good])
                continue
            roots = self._roots(batch, good, net)
            mean, covariance = _moments(np.array([r.augmentedJacobianUnweighted() for r in roots]))
            sound = _sound(mean, covariance)
            if sound.all():
                self._store(batch, good, net, roots)
                kept = batch.slot[good]
                self._mean[kept], self._covariance[kept] = mean, covariance
                break
            good[good] = sound
        return good

    def _frame_graph(
        self, batch: NodeBatch, rows: WhitenedRows, good: NDArray[np.bool_]
    ) -> tuple[Any, list[int]]:
        graph = gtsam.GaussianFactorGraph()
        keys: list[int] = []
        births, slots, counts = batch.birth.tolist(), batch.slot.tolist(), rows.count.tolist()
        for row in np.nonzero(good)[0].tolist():
            slot = slots[row]
            if births[row]:
                new = slot << _INDEX_BITS
                count = counts[row]
                graph.add(new, rows.current[row, :count], rows.target[row, :count])
            else:
                chain = self._chains[slot]
                new = (slot << _INDEX_BITS) + chain.count
                graph.push_back(chain.roots[-1])
                keys.append(new - 1)
                self._link(graph, new, rows, row)
            keys.append(new)
        return graph, keys

    def _link(self, graph: Any, new: int, rows: WhitenedRows, row: int) -> None:
        """Adds the factors between state `new - 1` and state `new`."""
        count = rows.count[row]
        previous, current, target = rows.previous[row], rows.current[row], rows.target[row]
        if not self._separate:
            graph.add(new - 1, previous[:count], new, current[:count], target[:count])
            return
        graph.add(new - 1, previous[:6], new, current[:6], target[:6])
        for first in range(6, count, 2):
            graph.add(new, current[first : first + 2], target[first : first + 2])

    def _roots(self, batch: NodeBatch, good: NDArray[np.bool_], net: Any) -> list[Any]:
        """New roots in the order of the rows; raises where the net has lost that order."""
        last = np.cumsum(np.where(batch.birth[good], 1, 2)) - 1
        roots = [net.at(position) for position in last.tolist()]
        for slot, root in zip(batch.slot[good].tolist(), roots, strict=True):
            chain = self._chains.get(slot)
            if root.firstFrontalKey() != (slot << _INDEX_BITS) + (chain.count if chain else 0):
                raise RuntimeError(f"elimination order changed near key {root.firstFrontalKey()}")
        return roots

    def _store(self, batch: NodeBatch, good: NDArray[np.bool_], net: Any, roots: list[Any]) -> None:
        """Takes the conditionals out of the net, which keeps the order of the tracks."""
        births, slots = batch.birth[good].tolist(), batch.slot[good].tolist()
        position = 0
        for slot, birth, root in zip(slots, births, roots, strict=True):
            if birth:
                chain = self._chains[slot] = _Chain()
            else:
                chain = self._chains[slot]
                chain.conditionals.append(net.at(position))
                position += 1
            chain.roots.append(root)
            chain.count += 1
            position += 1

    def _drop_oldest(self, slot: int) -> None:
        chain = self._chains[slot]
        if chain.roots[1] is None:
            chain.roots[1] = self._advanced_root(slot)
        chain.conditionals.popleft()
        chain.roots.popleft()

    def _advanced_root(self, slot: int) -> Any:
        """Root of the window's second state, from that of its oldest."""
        chain, window = self._chains[slot], self._windows[slot]
        first = (slot << _INDEX_BITS) + chain.count - len(chain.roots)
        graph = gtsam.GaussianFactorGraph()
        graph.push_back(chain.roots[0])
        self._link(graph, first + 1, self._whitened([slot], [window[1]]), 0)
        return _eliminate(graph, [first, first + 1]).at(1)

    def _whitened(self, slots: list[int], nodes: list[Node]) -> WhitenedRows:
        """Factors of nodes, each with the slot of its track."""
        dt_s = np.array([node.dt_s for node in nodes])
        return whiten(stacked(nodes), self._anchor_m[slots], dt_s, self.noise)

    def _forget(self, slot: int) -> None:
        del self._chains[slot]

    def _smooth(self, slot: int, covariance: bool) -> tuple[F64, F64 | None]:
        chain = self._chains[slot]
        net = gtsam.GaussianBayesNet()
        for conditional in chain.conditionals:
            net.push_back(conditional)
        net.push_back(chain.roots[-1])
        size = len(chain.roots)
        first = (slot << _INDEX_BITS) + chain.count - size
        mean = net.optimize().vector(list(range(first, first + size))).reshape(size, 6)
        return mean, self._smoothed_covariance(slot) if covariance else None

    def _smoothed_covariance(self, slot: int) -> F64:
        """Back-substitution of `R x_k + S x_k+1 = d`: `P_k = R^-1 R^-T + L P_k+1 L^T`."""
        conditionals = self._chains[slot].conditionals
        spread = np.empty((len(conditionals) + 1, 6, 6))
        spread[-1] = self._covariance[slot]
        for k in range(len(conditionals) - 1, -1, -1):
            jacobian = conditionals[k].augmentedJacobianUnweighted()
            inverse = np.linalg.inv(jacobian[:, :6])
            gain = inverse @ jacobian[:, 6:12]
            spread[k] = inverse @ inverse.T + gain @ spread[k + 1] @ gain.T
        return spread

    def _resolve(self, slots: list[int]) -> None:
        while slots:
            try:
                self._solve_windows(slots)
            except RuntimeError as failure:
                culprit = _culprit(failure, np.array(slots))
                slots = [slot for slot in slots if slot != culprit]
            else:
                break

    def _solve_windows(self, slots: list[int]) -> None:
        open_nodes = {slot: self._open_nodes(slot) for slot in slots}
        slots = [slot for slot in slots if open_nodes[slot]]
        owners = [slot for slot in slots for _ in open_nodes[slot]]
        if not owners:
            return
        rows = self._whitened(owners, [node for slot in slots for node in open_nodes[slot]])
        graph, keys = gtsam.GaussianFactorGraph(), []
        row = 0
        for slot in slots:
            chain = self._chains[slot]
            key = (slot << _INDEX_BITS) + chain.count - len(chain.roots)
            if len(open_nodes[slot]) == len(chain.roots):
                chain.roots[0] = self._birth_root(key, rows, row)
                row += 1
            graph.push_back(chain.roots[0])
            keys.append(key)
            for _ in range(len(chain.roots) - 1):
                key += 1
                self._link(graph, key, rows, row)
                keys.append(key)
                row += 1
        self._replace(slots, _eliminate(graph, keys))

    def _open_nodes(self, slot: int) -> list[Node]:
        """Nodes of a window whose weights may change: all but the oldest, or all from a birth."""
        nodes = list(self._windows[slot])
        return nodes if nodes[0].is_birth else nodes[1:]

    @staticmethod
    def _birth_root(key: int, rows: WhitenedRows, row: int) -> Any:
        graph = gtsam.GaussianFactorGraph()
        count = rows.count[row]
        graph.add(key, rows.current[row, :count], rows.target[row, :count])
        return _eliminate(graph, [key]).at(0)

    def _replace(self, slots: list[int], net: Any) -> None:
        """Takes whole windows out of the net of a re-solve."""
        position = 0
        for slot in slots:
            chain = self._chains[slot]
            size = len(chain.roots)
            found = [net.at(position + k) for k in range(size)]
            position += size
            chain.conditionals = deque(found[:-1])
            if size > 1:
                chain.roots = deque([chain.roots[0], *[None] * (size - 2), found[-1]])
            mean, covariance = _moments(found[-1].augmentedJacobianUnweighted()[None])
            self._mean[slot], self._covariance[slot] = mean[0], covariance[0]


def _culprit(failure: RuntimeError, slots: NDArray[np.int64]) -> int:
    """Slot, among those eliminated, of the track that failed; re-raises what names none."""
    match = _NEAR_VARIABLE.search(str(failure))
    slot = int(match.group(1)) >> _INDEX_BITS if match else -1
    if slot not in slots:
        raise failure
    return slot


def _sound(mean: F64, covariance: F64) -> NDArray[np.bool_]:
    """(N,) states that are determined: QR pads a singular chain with noise where it can."""
    variance = np.einsum("nii->ni", covariance)
    with np.errstate(invalid="ignore"):
        sound: NDArray[np.bool_] = np.isfinite(mean).all(axis=1) & (variance < 1e12).all(axis=1)
    return sound


def _eliminate(graph: Any, keys: list[int]) -> Any:
    """Bayes net of `graph`. QR: Cholesky rejects healthy tracks whose motion noise is small."""
    return graph.eliminateSequential(gtsam.Ordering(keys), gtsam.EliminateQR)


def _moments(jacobian: F64) -> tuple[F64, F64]:
    """Mean (N, 6) and covariance (N, 6, 6) of roots `R x = d`, from (N, 6, 7) `[R d]`."""
    inverse = np.linalg.inv(jacobian[:, :, :6])
    mean = np.einsum("nij,nj->ni", inverse, jacobian[:, :, 6])
    return mean, inverse @ inverse.transpose(0, 2, 1)

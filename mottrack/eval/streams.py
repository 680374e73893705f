"""Sums, quantiles and tails of values that come in pieces and are too many to be held.

All equal, to the last bit, what numpy says of the same values in one array. A quantile is exact
without sorting: a first pass counts the values by the leading bits of their binary form, which
orders them, and a second one holds those that share these bits with a wanted one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64

_DROPPED_BITS = 41
"""Of the 52 of the fraction: the 11 that are left tell values apart that differ by 0.05 %, so that
a wanted value shares its bin with few others."""
_HELD = 1 << 18
"""Values that are held before equal ones are joined: 2 MB."""
_LEAF, _UNROLLED = 128, 8
"""numpy adds up to 128 values in one loop, unrolled by 8, and halves longer arrays there
(pairwise summation, Higham 1993)."""


class RunningSum:
    """What ``numpy.sum`` returns for an array of known length whose values come in pieces."""

    def __init__(self, size: int) -> None:
        """Start with nothing.

        Args:
            size: of the whole array.
        """
        self._open = [size] if size else []
        self._sums: list[float] = []
        self._rest = np.zeros(0)

    def add(self, values: F64) -> None:
        """Take the next values (N,)."""
        values = np.concatenate([self._rest, values]) if len(self._rest) else values
        start = 0
        while self._open:
            size = self._open.pop()
            if size == 0:  # both halves are there
                second, first = self._sums.pop(), self._sums.pop()
                self._sums.append(first + second)
            elif start + size <= len(values):
                self._sums.append(float(np.sum(values[start : start + size])))
                start += size
            elif size <= _LEAF or start == len(values):
                self._open.append(size)
                break
            else:
                half = size // 2 - size // 2 % _UNROLLED
                self._open += [0, size - half, half]
        self._rest = values[start:].copy()

    @property
    def total(self) -> float:
        """The sum of the whole array; 0 for an empty one."""
        if self._open:
            raise AssertionError("values are missing")
        return self._sums[0] if self._sums else 0.0


class Largest:
    """The largest of all values, with the scene that each is of."""

    def __init__(self, count: int) -> None:
        """Keep at most that many."""
        self._count = count
        self._values = [np.zeros(0)]
        self._scenes = [np.zeros(0, np.int64)]
        self._held = 0

    def add(self, values: F64, scene: int = 0) -> None:
        """Take the values (N,) of a scene."""
        if not self._count:
            return
        self._values.append(values)
        self._scenes.append(np.full(len(values), scene))
        self._held += len(values)
        if self._held > 2 * self._count + _HELD:
            self._cut()

    def ascending(self) -> tuple[F64, I64]:
        """Return the values (M,), the smallest first, and the scene of each."""
        self._cut()
        order = np.argsort(self._values[0], kind="stable")
        return self._values[0][order], self._scenes[0][order]

    def _cut(self) -> None:
        values, scenes = np.concatenate(self._values), np.concatenate(self._scenes)
        if len(values) > self._count:
            kept = np.argpartition(values, len(values) - self._count)[-self._count :]
            kept.sort()
            values, scenes = values[kept], scenes[kept]
        self._values, self._scenes, self._held = [values], [scenes], len(values)


@dataclass(frozen=True)
class Wanted:
    """What a `Distribution` is asked for beside its mean."""

    quantiles: tuple[float, ...] = ()
    """Between 0 and 1."""
    largest_share: float = 0.0
    """Share of the values, the largest ones, of which the mean is asked for; 0: none."""


class Distribution:
    """Mean, quantiles and tail of values of at least 0, which pass twice.

    All pieces are given to `count`, then all again, in the same order, to `add`.
    """

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self.size = 0
        self._zeros = 0
        self._bins = _Bins()
        self._second: _SecondPass | None = None

    def count(self, values: F64) -> None:
        """Take values (N,) in the first pass."""
        bins = _bin(values[values > 0.0])
        self.size += len(values)
        self._zeros += len(values) - len(bins)
        self._bins.count(bins)

    def add(self, values: F64) -> None:
        """Take the same values in the second pass."""
        self._second = self._second or self._begin()
        self._second.sum.add(values)
        self._second.largest.add(values)
        self._second.keep(values)

    def _begin(self) -> _SecondPass:
        bins, counts = self._bins.occupied()
        starts = self._zeros + np.cumsum(counts) - counts
        ranks = {rank for q in self._wanted.quantiles for rank in self._ranks(q)}
        places = {r: int(np.searchsorted(starts, r, "right")) - 1 for r in ranks}
        wanted = {r: _Place(int(bins[k]), r - int(starts[k])) for r, k in places.items() if k >= 0}
        return _SecondPass(wanted, self.size, self._tail)

    @property
    def _tail(self) -> int:
        """Number of the largest values; one at least, if any is asked for."""
        share = self._wanted.largest_share
        return max(1, round(share * self.size)) if share else 0

    def _ranks(self, q: float) -> tuple[int, int]:
        place = int(np.floor(q * (self.size - 1)))
        return place, min(place + 1, self.size - 1)

    @property
    def mean(self) -> float:
        """As ``numpy.mean``; NaN without values."""
        if self._second is None or not self.size:
            return float("nan")
        return self._second.sum.total / self.size

    @property
    def mean_of_largest(self) -> float:
        """Mean of the largest share; NaN without values."""
        if self._second is None or not self.size:
            return float("nan")
        return float(self._second.largest.ascending()[0].mean())

    @property
    def median(self) -> float:
        """As ``numpy.median``; the quantile 0.5 must have been asked for."""
        if not self.size:
            return float("nan")
        return (self._at((self.size - 1) // 2) + self._at(self.size // 2)) / 2

    def quantile(self, q: float) -> float:
        """As ``numpy.quantile``: linear between the neighbours; NaN without values."""
        if not self.size:
            return float("nan")
        low, high = map(self._at, self._ranks(q))
        share = q * (self.size - 1) - self._ranks(q)[0]
        step = high - low
        return high - step * (1 - share) if share >= 0.5 else low + step * share

    def _at(self, rank: int) -> float:
        if self._second is None:
            raise AssertionError("no value was given twice")
        return 0.0 if rank < self._zeros else self._second.at(rank)


class _Bins:
    """How many values lie in each bin, from the first bin that holds one to the last."""

    def __init__(self) -> None:
        self._first = 0
        self._counts = np.zeros(0, np.int64)

    def count(self, bins: I64) -> None:
        """Count the bins of some values (N,)."""
        if not len(bins):
            return
        low = int(bins.min())
        counts = np.bincount(bins - low)
        if not len(self._counts):
            self._first = low
        before = max(self._first - low, 0)
        after = max(low + len(counts) - self._first - len(self._counts), 0)
        self._counts = np.pad(self._counts, (before, after))
        self._first -= before
        self._counts[low - self._first :][: len(counts)] += counts

    def occupied(self) -> tuple[I64, I64]:
        """Return the bins that hold a value, ascending, and how many each holds."""
        rows = np.flatnonzero(self._counts)
        return rows + self._first, self._counts[rows]


class _Place(NamedTuple):
    """Where a value of a certain rank lies."""

    bin: int
    within: int
    """Its rank among the values of the bin."""


class _SecondPass:
    """What is held in the second pass."""

    def __init__(self, wanted: dict[int, _Place], size: int, tail: int) -> None:
        """Prepare.

        Args:
            wanted: rank of a value, among all in ascending order, to its place.
            size: number of all values.
            tail: how many of the largest are wanted.
        """
        self.sum, self.largest = RunningSum(size), Largest(tail)
        self._wanted = wanted
        self._chosen = np.array(sorted({place.bin for place in wanted.values()}), np.int64)
        self._values, self._counts = np.zeros(0), np.zeros(0, np.int64)
        self._held: list[F64] = []

    def keep(self, values: F64) -> None:
        """Hold the values (N,) whose bin holds a wanted one."""
        if not len(self._chosen):
            return
        bins = _bin(values)
        place = np.minimum(np.searchsorted(self._chosen, bins), len(self._chosen) - 1)
        self._held.append(values[(self._chosen[place] == bins) & (values > 0.0)])
        if sum(map(len, self._held)) > _HELD:
            self._join()

    def at(self, rank: int) -> float:
        """Return the value of a wanted rank."""
        self._join()
        place = self._wanted[rank]
        first = int(np.searchsorted(_bin(self._values), place.bin))
        ends = np.cumsum(self._counts[first:])
        return float(self._values[first + int(np.searchsorted(ends, place.within, "right"))])

    def _join(self) -> None:
        """Join equal values."""
        if self._held:
            every = np.concatenate([self._values, *self._held])
            ones = [np.ones(len(part), np.int64) for part in self._held]
            counts = np.concatenate([self._counts, *ones])
            self._values, index = np.unique(every, return_inverse=True)
            self._counts = np.bincount(index, counts, len(self._values)).astype(np.int64)
            self._held = []


def _bin(values: F64) -> I64:
    """Return the leading bits of values of at least 0, which order them, (N,)."""
    return np.ascontiguousarray(values + 0.0).view(np.int64) >> _DROPPED_BITS

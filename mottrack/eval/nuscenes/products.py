"""How a matrix product of two columns rounds: the official distance depends on it.

The devkit computes sqrt(|g|^2 + |p|^2 - 2 g.p) with g.p from a matrix product, whose kernel is the
processor's. A sum of two products rounds in one of three ways, and which one depends on the shape
of the matrix: `RECORDED` is OpenBLAS with AVX-512, on which the recorded evaluations were made; on
processors with AVX2 (AMD, older Intel) a product of one box with one box is not fused.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from mottrack.compiled import compiled
from mottrack.core.arrays import F64

LAST_FUSED, FIRST_FUSED, PLAIN = range(3)
"""fma(y, y', x x'), fma(x, x', y y'), x x' + y y' with both products rounded."""


class Products(NamedTuple):
    """Which of the three a product takes, by the number of true and of predicted boxes."""

    wide: int
    """More than one of both."""
    thin: int
    """One box on exactly one side."""
    single: int
    """One on both."""


@intrinsic  # type: ignore[untyped-decorator]  # numba ships no types
def fma(_context: Any, _a: Any, _b: Any, _c: Any) -> Any:
    """Return a * b + c, rounded once."""
    signature = types.float64(types.float64, types.float64, types.float64)

    def build(_target: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return signature, build


@compiled(no_cfunc_wrapper=True)
def product(way: int, x: float, y: float, a: float, b: float) -> float:
    """Return x a + y b, rounded in one of the three ways."""
    if way == LAST_FUSED:
        return float(fma(y, b, x * a))
    if way == FIRST_FUSED:
        return float(fma(x, a, y * b))
    return x * a + y * b


RECORDED = Products(LAST_FUSED, FIRST_FUSED, LAST_FUSED)
_PROBES = 32
"""Random pairs: the three ways agree on about half of them, so on all with a chance of 2^-32."""
_SHAPES = ((3, 4), (1, 4), (1, 1))
_RANGE_M = 2500.0
"""Coordinates of nuScenes' maps reach this far."""


def of_this_machine() -> Products:
    """Return what numpy's matrix product does here; as recorded where it is none of the three."""
    found = [_way(shape, recorded) for shape, recorded in zip(_SHAPES, RECORDED, strict=True)]
    return Products(*found)


def _way(shape: tuple[int, int], recorded: int) -> int:
    rng = np.random.default_rng(0)
    possible = set(range(3))
    for _ in range(_PROBES):
        truth, tracks = (rng.uniform(100.0, _RANGE_M, (count, 2)) for count in shape)
        given = truth @ tracks.T
        ways = _ways(truth, tracks)
        possible = {way for way in possible if np.array_equal(ways[way], given)}
    return min(possible, default=recorded)


def _ways(truth: F64, tracks: F64) -> list[F64]:
    """Return all products of rows (N, 2) and (M, 2), (N, M), rounded in each of the three ways."""
    return [
        np.array([[product(way, *g, *p) for p in tracks.tolist()] for g in truth.tolist()])
        for way in range(3)
    ]

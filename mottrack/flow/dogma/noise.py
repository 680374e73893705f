"""Counter-based random numbers: the same for any number of threads.

Each particle draws from a hash of (seed, cycle, stage, index), so no generator has a state that
threads would have to share.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_1, _SHIFT_2, _SHIFT_3 = np.uint64(30), np.uint64(27), np.uint64(31)
"""The constants of SplitMix64."""
_LEVEL_BITS = np.uint64(12)
_LEVEL_MASK = np.uint64(0xFFF)
"""12 bits a number: 64 bits hold five, all that one particle needs, and the tables of 4096 values
stay in the cache."""
# centres of the 4096 steps of [0, 1)
_UNIFORM_STEP = np.float32(1.0 / 4096.0)
_HALF = np.float32(0.5)


def _normal_levels() -> F32:
    """Return 4096 equally likely values of the standard normal, scaled to variance one."""
    levels = np.array([NormalDist().inv_cdf((k + 0.5) / 4096) for k in range(4096)])
    return np.array(levels / levels.std(), np.float32)


_NORMAL = _normal_levels()


def stream(seed: int, cycle: int, stage: int) -> np.uint64:
    """Return the key of one stage of one cycle of the filter."""
    mixed = np.uint64(0)
    for part in (seed, cycle, stage):
        mixed = np.uint64(draw(mixed, np.uint64(part)))
    return mixed


def uniform(key: np.uint64) -> float:
    """Return one number in [0, 1), of 53 bits, for a whole stage."""
    return float(np.uint64(draw(key, np.uint64(0))) >> np.uint64(11)) * 2.0**-53


@compiled(nogil=True)
def draw(key: np.uint64, counter: np.uint64) -> np.uint64:
    """Return 64 random bits of (key, counter): the finaliser of SplitMix64 (Steele et al. 2014)."""
    z = key + (np.uint64(counter) + np.uint64(1)) * _GOLDEN
    z = (z ^ (z >> _SHIFT_1)) * _MIX_1
    z = (z ^ (z >> _SHIFT_2)) * _MIX_2
    return z ^ (z >> _SHIFT_3)


@compiled(nogil=True)
def normal_level(bits: np.uint64, slot: int) -> np.float32:
    """Return a standard normal from the 12 bits of `slot` 0..4, by a table of quantiles."""
    level: np.float32 = _NORMAL[(bits >> (np.uint64(slot) * _LEVEL_BITS)) & _LEVEL_MASK]
    return level


@compiled(nogil=True)
def uniform_level(bits: np.uint64, slot: int) -> np.float32:
    """Return a uniform number in (0, 1) from the 12 bits of `slot` 0..4."""
    level = (bits >> (np.uint64(slot) * _LEVEL_BITS)) & _LEVEL_MASK
    return (np.float32(level) + _HALF) * _UNIFORM_STEP

"""Randomness by counter: the same (seed, ray, thing) draws the same number in any order.

SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014) used as
a hash, so that a sweep does not depend on which rays were cast before it.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import Int

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_MASK_16 = np.uint64(0xFFFF)
_TO_UNIT = 1.0 / 9007199254740992.0
_IRWIN_HALL_SCALE = np.sqrt(3.0) / 65536.0


@compiled
def mix(seed: np.uint64, counter: Int) -> np.uint64:
    """64 random bits for the ``counter``-th draw of ``seed``."""
    z = seed + np.uint64(counter + 1) * _GAMMA
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


@compiled
def unit(bits: np.uint64) -> float:
    """A number in (0, 1) from 64 random bits."""
    return (np.float64(bits >> np.uint64(11)) + 0.5) * _TO_UNIT


@compiled
def bell(bits: np.uint64) -> float:
    """Near-normal number of unit variance, within +-3.5: the sum of four 16-bit uniforms."""
    total = np.float64(bits & _MASK_16)
    total += np.float64((bits >> np.uint64(16)) & _MASK_16)
    total += np.float64((bits >> np.uint64(32)) & _MASK_16)
    total += np.float64(bits >> np.uint64(48))
    return float((total - 131070.0) * _IRWIN_HALL_SCALE)

"""Counter-based random numbers: a hash of (seed, counter) gives the same number in any order.

SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014) serves
as the hash, so that a sweep does not depend on which rays were cast before.
"""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import Int

# increment and multipliers of SplitMix64, as published
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MULTIPLIER_1 = np.uint64(0xBF58476D1CE4E5B9)
_MULTIPLIER_2 = np.uint64(0x94D049BB133111EB)
_MASK_16 = np.uint64(0xFFFF)
_ULP = 2.0**-53  # A double has 53 significant bits
_IRWIN_HALL_MEAN = 4 * 65535 / 2
_IRWIN_HALL_SCALE = np.sqrt(3.0) / 65536.0
"""One over the deviation of a sum of four uniforms on 0 .. 65535: sqrt(4 * 65536^2 / 12)."""


@compiled
def random_bits(seed: np.uint64, counter: Int) -> np.uint64:
    """Return the 64 random bits of draw ``counter`` of ``seed``."""
    z = seed + np.uint64(counter + 1) * _GAMMA
    z = (z ^ (z >> np.uint64(30))) * _MULTIPLIER_1
    z = (z ^ (z >> np.uint64(27))) * _MULTIPLIER_2
    return z ^ (z >> np.uint64(31))


@compiled
def uniform(bits: np.uint64) -> float:
    """Return a number in (0, 1) from 64 random bits."""
    return (np.float64(bits >> np.uint64(11)) + 0.5) * _ULP


@compiled
def near_normal(bits: np.uint64) -> float:
    """Return a nearly normal number of unit variance within +-3.5: a sum of four uniforms."""
    total = np.float64(bits & _MASK_16)
    total += np.float64((bits >> np.uint64(16)) & _MASK_16)
    total += np.float64((bits >> np.uint64(32)) & _MASK_16)
    total += np.float64(bits >> np.uint64(48))
    return float((total - _IRWIN_HALL_MEAN) * _IRWIN_HALL_SCALE)

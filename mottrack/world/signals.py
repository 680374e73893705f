"""Traffic lights: one approach after the other, then the pedestrians."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64

NO_SIGNAL = -1


class Signals(NamedTuple):
    """Cyclic plan; named tuple for numba. The last phase belongs to those who walk."""

    green_s: F64
    """(A + 1,) green of each approach, then of the crossings."""
    clear_s: float
    """All red after each green."""
    shift_s: float


@compiled
def is_green(signals: Signals, approach: int, time_s: float) -> bool:
    """Whether ``approach`` may go at ``time_s``."""
    cycle = signals.green_s.sum() + len(signals.green_s) * signals.clear_s
    clock = (time_s + signals.shift_s) % cycle
    for phase in range(len(signals.green_s)):
        if clock < signals.green_s[phase]:
            return phase == approach
        clock -= signals.green_s[phase] + signals.clear_s
        if clock < 0.0:
            return False
    return False


def random_signals(rng: np.random.Generator, approaches: int) -> Signals:
    """A plan for that many approaches.

    The first, on which the ego vehicle comes, gets most of the green, and gets it near the
    beginning more often than not: scenes are shorter than a cycle of lights.
    """
    green = np.append(rng.uniform(4.0, 7.0, approaches), 8.0)
    green[0] = rng.uniform(10.0, 20.0)
    shift = -rng.uniform(-6.0, 9.0) if rng.random() < 0.65 else rng.uniform(0.0, 60.0)
    return Signals(green, 2.0, float(shift))

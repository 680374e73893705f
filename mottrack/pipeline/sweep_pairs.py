"""Selection of the earlier sweep that flow is measured from."""

from __future__ import annotations

from collections import deque

from mottrack.core.errors import InputError
from mottrack.core.sweep import Sweep, has_jumped, seconds_between

GAPS = 3
"""Gaps after which a scene without any pair is refused: one or two may be lost sweeps."""


class SweepPairs:
    """Keeps the last sweeps and selects the one whose age is nearest to ``pair_s``.

    Sweeps before a jump of the pose are no partners: between them the ego motion is not known.

    At 20 Hz a pedestrian moves less than the noise from one sweep to the next, at 2 Hz vehicles
    move by several lengths; 0.1 s suits both. Sweeps further apart than ``max_pair_s`` are no
    pair: a scene may have a gap, but one that never has a pair is an error where pairs are
    `required`: not if no flow is measured (trackers on key frames, clusters without flow).
    """

    def __init__(self, pair_s: float, max_pair_s: float, *, required: bool = True) -> None:
        self._pair_s, self._max_pair_s, self._required = pair_s, max_pair_s, required
        self._sweeps: deque[Sweep] = deque()
        self._paired = False
        self._gaps = 0

    def push(self, sweep: Sweep, *, consecutive: bool = False) -> Sweep | None:
        """Add the newest sweep; return its partner, None where there is none in reach.

        Args:
            sweep: later than all before.
            consecutive: for a source that filters over time: always the last sweep.

        Raises:
            InputError: the first three sweeps in a row have no partner: this data set has key
                frames only, from which flow can't be measured.
        """
        if self._sweeps and has_jumped(self._sweeps[-1], sweep):
            self._sweeps.clear()
        ages = {id(s): seconds_between(s.stamp_ns, sweep.stamp_ns) for s in self._sweeps}
        while self._sweeps and ages[id(self._sweeps[0])] > self._max_pair_s:
            self._sweeps.popleft()
            self._gaps += 1
        partner: Sweep | None = None
        if self._sweeps:
            partner = self._sweeps[-1] if consecutive else self._nearest(ages)
            self._paired = True
        elif self._required and self._gaps >= GAPS and not self._paired:
            raise InputError(
                "time between sweeps",
                f"{min(ages.values(), default=0.0):.2f} s",
                f"at most {self._max_pair_s} s: objects move too far between key frames for flow; "
                "read the sweeps between them",
            )
        self._sweeps.append(sweep)
        return partner

    def _nearest(self, ages: dict[int, float]) -> Sweep:
        return min(self._sweeps, key=lambda s: abs(ages[id(s)] - self._pair_s))

"""Selection of the earlier sweeps that flow is measured from."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from mottrack.core.errors import InputError
from mottrack.core.interfaces import FlowSource
from mottrack.core.sweep import Sweep, has_jumped, seconds_between
from mottrack.experiment.settings import Settings

GAPS = 3
"""Gaps after which a scene without any pair is refused: one or two may be lost sweeps."""


@dataclass(frozen=True)
class PairConfig:
    """Which earlier sweeps are chosen."""

    pair_s: float
    """Desired age of the newest."""
    max_pair_s: float
    """Greatest age of the newest."""
    history_s: float
    """Desired age of the oldest, if more than one is wanted."""
    past_sweeps: int = 1
    """Number of sweeps, at most."""
    consecutive: bool = False
    """The newest is always the last one: for a source that filters over time."""

    @classmethod
    def of(cls, settings: Settings, source: FlowSource) -> PairConfig:
        """Return the choice of an experiment for its flow source.

        Raises:
            InputError: the source declares a number of past sweeps that is not positive.
        """
        if source.past_sweeps < 1:
            raise InputError("past_sweeps", source.past_sweeps, "at least 1")
        return cls(
            settings.pair_s,
            settings.max_pair_s,
            settings.history_s,
            source.past_sweeps,
            source.stateful,
        )

    @property
    def ages_s(self) -> list[float]:
        """Desired ages of the sweeps older than the newest, from the next older one on."""
        if self.past_sweeps < 2 or self.history_s <= self.pair_s:
            return []
        ages: list[float] = np.linspace(self.pair_s, self.history_s, self.past_sweeps).tolist()
        return ages[1:]

    @property
    def slack_s(self) -> float:
        """How far an age may be from the desired one: less than half the spacing."""
        return (self.history_s - self.pair_s) / max(self.past_sweeps - 1, 1) / 2 - 1e-6

    @property
    def kept_s(self) -> float:
        """Age up to which sweeps can be chosen."""
        return max([self.max_pair_s, *(age_s + self.slack_s for age_s in self.ages_s[-1:])])


class SweepPairs:
    """Keeps the last sweeps and selects those of the ages nearest to the desired ones.

    Sweeps before a jump of the pose are not chosen: between them the ego motion is not known.

    At 20 Hz a pedestrian moves less than the noise from one sweep to the next, at 2 Hz vehicles
    move by several lengths; 0.1 s suits both. Sweeps further apart than ``max_pair_s`` are no
    pair: a scene may have a gap, but one that never has a pair is an error where pairs are
    `required`: not if no flow is measured (trackers on key frames, clusters without flow).
    """

    def __init__(self, config: PairConfig, *, required: bool = True) -> None:
        self._config, self._required = config, required
        self._sweeps: deque[Sweep] = deque()
        self._paired = False
        self._gaps = 0

    def push(self, sweep: Sweep) -> tuple[Sweep, ...]:
        """Add the newest sweep, later than all before; return its past, from the oldest on.

        The past is empty where no sweep is near enough in time.

        Raises:
            InputError: the first three sweeps in a row have no partner: this data set has key
                frames only, from which flow can't be measured.
        """
        if self._sweeps and has_jumped(self._sweeps[-1], sweep):
            self._sweeps.clear()
        ages_s = [seconds_between(s.stamp_ns, sweep.stamp_ns) for s in self._sweeps]
        last_s = ages_s[-1] if ages_s else None
        while ages_s and ages_s[0] > self._config.kept_s:
            self._sweeps.popleft()
            del ages_s[0]
        past = self._past(ages_s)
        if past:
            self._paired = True
        elif last_s is not None:
            self._gaps += 1
            self._refuse_key_frames(last_s)
        self._sweeps.append(sweep)
        return past

    def _past(self, ages_s: list[float]) -> tuple[Sweep, ...]:
        config = self._config
        near = [i for i, age_s in enumerate(ages_s) if age_s <= config.max_pair_s]
        if not near:
            return ()
        # the older one of two that are equally near, as everywhere else
        newest = near[-1] if config.consecutive else _nearest(ages_s, near, config.pair_s)
        chosen = [newest]
        for age_s in config.ages_s:
            older = [i for i in range(chosen[-1]) if abs(ages_s[i] - age_s) <= config.slack_s]
            if older:
                chosen.append(_nearest(ages_s, older, age_s))
        return tuple(self._sweeps[i] for i in reversed(chosen))

    def _refuse_key_frames(self, age_s: float) -> None:
        if self._paired or not self._required or self._gaps < GAPS:
            return
        raise InputError(
            "time between sweeps",
            f"{age_s:.2f} s",
            f"at most {self._config.max_pair_s} s: objects move too far between key frames for "
            "flow; read the sweeps between them",
        )


def _nearest(ages_s: list[float], among: list[int], wanted_s: float) -> int:
    return min(among, key=lambda i: abs(ages_s[i] - wanted_s))

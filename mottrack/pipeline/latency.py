"""Latency of the pipeline's stages against the period of the sensor."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import InputError, ResultError
from mottrack.core.timing import clock_s, collect_timings
from mottrack.formats.text_table import aligned

TOTAL = "total"
ORDER = ("flow", "objects", "velocity", "tracker")
"""Stages in the order of a step."""


class Stopwatch:
    """Accumulates the wall time of named stages: per key frame, and per lap."""

    def __init__(self) -> None:
        self._frames: list[dict[str, float]] = [{}]
        self._lap: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a ``with`` block as ``stage``, and its parts as ``stage.part``."""
        start = clock_s()
        with collect_timings(lambda part, seconds: _add(self._lap, f"{stage}.{part}", seconds)):
            yield
        seconds = clock_s() - start
        _add(self._frames[-1], stage, seconds)
        _add(self._lap, stage, seconds)

    def lap(self) -> dict[str, float]:
        """Return seconds by stage, and by part of a stage, since the last lap; start a new one."""
        lap, self._lap = self._lap, {}
        return lap

    def next_frame(self) -> None:
        """Start the next key frame."""
        self._frames.append({})

    def seconds(self) -> dict[str, F64]:
        """Return per stage (T,) seconds of each finished key frame; 0 where it did not run."""
        frames = self._frames[:-1]
        stages = dict.fromkeys(stage for frame in frames for stage in frame)
        return {s: np.array([frame.get(s, 0.0) for frame in frames]) for s in stages}


def _add(totals: dict[str, float], name: str, seconds: float) -> None:
    totals[name] = totals.get(name, 0.0) + seconds


@dataclass(frozen=True)
class StageLatency:
    """Wall time of one stage, over the steps in which it ran."""

    steps: int
    mean_ms: float
    p50_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, seconds: list[float]) -> StageLatency:
        """Summarise at least one measured time."""
        ms = 1e3 * np.array(seconds)
        p50, p99 = np.percentile(ms, (50, 99))
        return cls(len(ms), float(ms.mean()), float(p50), float(p99), float(ms.max()))


@dataclass(frozen=True)
class Bottleneck:
    """The stage that took most time in the steps over budget (in all of them, if none was)."""

    stage: str
    share: float
    """Of the time of those steps."""


@dataclass(frozen=True)
class LatencyReport:
    """Latency of the last steps against the time between two sweeps. Print it for a table.

    The one definition of latency here: the wall time of a step in which every stage ran, reading
    of files and the warm-up left out. Steps between key frames, and the first ones of a scene,
    which have no earlier sweep, do a part of the work only and do not count.
    """

    budget_ms: float
    """Time between two sweeps."""
    steps: int
    """Number of steps in which every stage ran, without those of the warm-up."""
    stages: dict[str, StageLatency]
    """By stage, a part of one as ``stage.part``; ``total`` is the whole step."""
    over_budget: int
    """Number of steps that took longer than the budget."""
    bottleneck: Bottleneck | None
    """None before the first step beyond the warm-up."""
    warm_up_ms: dict[str, float]
    """By stage, the steps in which some stage ran for the first time: compiling, loading."""

    @property
    def over_budget_share(self) -> float:
        """Share of the steps that took longer than the budget; 0 without any step."""
        return self.over_budget / self.steps if self.steps else 0.0

    def __str__(self) -> str:
        rows = [["ms", "mean", "p50", "p99", "max", "steps", "warm-up"]]
        for name, s in self.stages.items():
            stage, _, part = name.partition(".")
            times = [f"{ms:.2f}" for ms in (s.mean_ms, s.p50_ms, s.p99_ms, s.max_ms)]
            warm_up = f"{self.warm_up_ms.get(name, 0.0):.0f}"
            rows.append([f"  of it {part}" if part else stage, *times, str(s.steps), warm_up])
        return f"{aligned(rows)}\n{self.summary}"

    @property
    def summary(self) -> str:
        """Whether the budget was kept, and where the time went, in one line."""
        if self.bottleneck is None:
            return f"budget {self.budget_ms:.0f} ms: no step yet beyond the warm-up"
        return (
            f"budget {self.budget_ms:.0f} ms: {self.over_budget} of {self.steps} steps over it "
            f"({self.over_budget_share:.1%}); most time in {self.bottleneck.stage} "
            f"({self.bottleneck.share:.0%})"
        )


@dataclass(frozen=True)
class StepTimes:
    """Wall times of the steps of a scene, or of several."""

    period_s: float
    """Time between two sweeps, the budget of a step."""
    steps: list[dict[str, float]]
    """Seconds by stage of every step beyond the warm-up; ``total`` is the whole step."""
    warm_up_s: dict[str, float]
    """Seconds by stage of the steps in which some stage ran for the first time."""

    @classmethod
    def of(cls, stored: Mapping[str, Any], source: Path) -> Self:
        """Read what `as_dict` made; ``source`` names the file in errors.

        Raises:
            ResultError: it is something else.
        """
        try:
            period_s, warm_up_s = float(stored["period_s"]), dict(stored["warm_up_s"])
            return cls(period_s, [dict(step) for step in stored["steps"]], warm_up_s)
        except (KeyError, TypeError, ValueError) as error:
            raise ResultError(source, "content", repr(error), "times of a scene") from error

    @classmethod
    def joined(cls, parts: Sequence[StepTimes]) -> Self:
        """Join scenes: the shortest period, every step, the longest warm-up of each stage."""
        stages = {stage for part in parts for stage in part.warm_up_s}
        longest_s = {s: max(part.warm_up_s.get(s, 0.0) for part in parts) for s in stages}
        steps = [step for part in parts for step in part.steps]
        return cls(min(part.period_s for part in parts), steps, longest_s)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, to be stored."""
        return asdict(self)

    def report(self) -> LatencyReport:
        """Summarise the steps in which every stage ran."""
        stages = {name for name in self.warm_up_s if "." not in name}
        steps = [step for step in self.steps if stages <= step.keys()]
        times = {s: [t[s] for t in steps if s in t] for s in _in_order(self.warm_up_s)}
        late = [step for step in steps if step[TOTAL] > self.period_s]
        return LatencyReport(
            budget_ms=1e3 * self.period_s,
            steps=len(steps),
            stages={stage: StageLatency.of(seconds) for stage, seconds in times.items() if seconds},
            over_budget=len(late),
            bottleneck=_bottleneck(late or steps),
            warm_up_ms={stage: 1e3 * spent_s for stage, spent_s in self.warm_up_s.items()},
        )


class LatencyLog:
    """Keeps the times of the last steps in bounded memory, however long a vehicle drives."""

    def __init__(self, rate_hz: float, window: int = 36_000) -> None:
        """Start an empty log.

        Args:
            rate_hz: of the sweeps.
            window: number of steps that are kept: an hour at 10 Hz.

        Raises:
            InputError: the rate is not positive, or the window is empty.
        """
        if not rate_hz > 0:
            raise InputError("rate_hz", rate_hz, "a positive number of sweeps a second")
        if window < 1:
            raise InputError("window", window, "at least one step")
        self._budget_s = 1.0 / rate_hz
        self._steps: deque[dict[str, float]] = deque(maxlen=window)
        self._warm_up_s: dict[str, float] = {}

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add one step: seconds by stage, ``total`` among them."""
        if seconds.keys() <= self._warm_up_s.keys():
            self._steps.append(dict(seconds))
            return
        for stage, spent_s in seconds.items():
            _add(self._warm_up_s, stage, spent_s)

    def times(self, period_s: float | None = None) -> StepTimes:
        """Return the kept steps; ``period_s`` between two sweeps, by default that of the rate."""
        return StepTimes(period_s or self._budget_s, list(self._steps), dict(self._warm_up_s))

    def report(self) -> LatencyReport:
        """Summarise the kept steps in which every stage ran."""
        return self.times().report()


def _in_order(stages: Iterable[str]) -> list[str]:
    """Sort stages by the order of a step, each followed by its parts; the total comes last."""
    found = list(dict.fromkeys(stages))
    parts: dict[str, list[str]] = {}
    for name in found:
        parts.setdefault(name.partition(".")[0], []).append(name)
    parts.pop(TOTAL, None)
    names = sorted(parts, key=lambda s: ORDER.index(s) if s in ORDER else len(ORDER))
    return [name for s in names for name in sorted(parts[s], key=lambda n: n != s)] + [TOTAL]


def _bottleneck(steps: list[dict[str, float]]) -> Bottleneck | None:
    totals: dict[str, float] = {}
    for step in steps:
        for name, spent_s in step.items():
            if "." not in name:
                _add(totals, name, spent_s)
    whole = totals.pop(TOTAL, 0.0)
    if not totals:
        return None
    stage = max(totals, key=lambda name: totals[name])
    return Bottleneck(stage, totals[stage] / whole)

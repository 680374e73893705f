"""Latency of the pipeline's stages against the period of the sensor."""

from __future__ import annotations

import math
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
from mottrack.eval.streams import Distribution, Wanted
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

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, to be stored."""
        return asdict(self)

    def report(self) -> LatencyReport:
        """Summarise the steps in which every stage ran."""
        return latency_report([self])

    @property
    def whole(self) -> StepTimes:
        """Those of the steps in which every stage ran; parts of stages may be absent."""
        stages = {name for name in self.warm_up_s if "." not in name}
        steps = [step for step in self.steps if stages <= step.keys()]
        return StepTimes(self.period_s, steps, self.warm_up_s)


def latency_report(scenes: Sequence[StepTimes]) -> LatencyReport:
    """Summarise the whole steps of scenes, at least one, which are read twice and not held.

    The budget is the shortest period, the warm-up of a stage the longest of any scene.
    """
    stages: dict[str, _Stage] = {}
    period_s, steps = math.inf, 0
    for times in (scene.whole for scene in scenes):
        period_s, steps = min(period_s, times.period_s), steps + len(times.steps)
        for name, spent_s in times.warm_up_s.items():
            stage = stages.setdefault(name, _Stage())
            stage.warm_up_s = max(stage.warm_up_s, spent_s)
        for name, ms in _milliseconds(times).items():
            stages.setdefault(name, _Stage()).ms.count(ms)
    late, every = _Spent(), _Spent()
    for times in (scene.whole for scene in scenes):
        for name, ms in _milliseconds(times).items():
            stages[name].add(ms)
        for step in times.steps:
            every.add(step)
            if step[TOTAL] > period_s:
                late.add(step)
    return LatencyReport(
        budget_ms=1e3 * period_s,
        steps=steps,
        stages={n: stages[n].summary() for n in _in_order(stages) if stages[n].ms.size},
        over_budget=late.steps,
        bottleneck=(late if late.steps else every).bottleneck(),
        warm_up_ms={n: 1e3 * stages[n].warm_up_s for n in _in_order(stages)},
    )


def _milliseconds(times: StepTimes) -> dict[str, F64]:
    """Return the times of each stage, over the steps in which it ran."""
    names = dict.fromkeys(name for step in times.steps for name in step)
    return {n: 1e3 * np.array([step[n] for step in times.steps if n in step]) for n in names}


class _Stage:
    """Wall time of one stage so far."""

    def __init__(self) -> None:
        self.warm_up_s = 0.0
        self.ms = Distribution(Wanted(quantiles=(0.5, 0.99)))
        self._max_ms = 0.0

    def add(self, ms: F64) -> None:
        """Take the steps of a scene in the second pass."""
        self.ms.add(ms)
        self._max_ms = max(self._max_ms, float(ms.max()))

    def summary(self) -> StageLatency:
        """Summarise at least one measured time."""
        ms = self.ms
        return StageLatency(ms.size, ms.mean, ms.quantile(0.5), ms.quantile(0.99), self._max_ms)


class _Spent:
    """Seconds by stage, parts apart, over some steps."""

    def __init__(self) -> None:
        self.steps = 0
        self._totals_s: dict[str, float] = {}

    def add(self, step: Mapping[str, float]) -> None:
        """Take a step."""
        self.steps += 1
        for name, spent_s in step.items():
            if "." not in name:
                _add(self._totals_s, name, spent_s)

    def bottleneck(self) -> Bottleneck | None:
        """Return the stage that took most; None without a step."""
        stages = {name: spent_s for name, spent_s in self._totals_s.items() if name != TOTAL}
        if not stages:
            return None
        stage = max(stages, key=lambda name: stages[name])
        return Bottleneck(stage, stages[stage] / self._totals_s.get(TOTAL, 0.0))


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
    total = [TOTAL] if TOTAL in found else []
    return [name for s in names for name in sorted(parts[s], key=lambda n: n != s)] + total

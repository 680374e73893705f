"""Does the pipeline keep up with its sensor, and if not, which stage is to blame?"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from mottrack.core.errors import InputError, ResultError

TOTAL = "total"


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
        """The figures of at least one measured time."""
        ms = 1e3 * np.array(seconds)
        p50, p99 = np.percentile(ms, (50, 99))
        return cls(len(ms), float(ms.mean()), float(p50), float(p99), float(ms.max()))


@dataclass(frozen=True)
class LatencyReport:
    """Latency of the last steps against the time between two sweeps. Print it for a table."""

    budget_ms: float
    """Time between two sweeps."""
    steps: int
    """Steps that are counted; those of the warm-up are not."""
    stages: dict[str, StageLatency]
    """By stage, a part of one as ``stage.part``; ``total`` is the whole step."""
    over_budget: int
    """Steps that took longer than the budget."""
    blame: str | None
    """Stage that took most time in the steps over budget (in all of them, where none was)."""
    blame_share: float
    """Its share of the time of those steps."""
    warm_up_ms: dict[str, float]
    """By stage, the steps in which some stage ran for the first time: compiling, loading."""

    @property
    def over_budget_share(self) -> float:
        """Share of the steps that took longer than the budget; 0 without any step."""
        return self.over_budget / self.steps if self.steps else 0.0

    def __str__(self) -> str:
        rows = [f"{'ms':16}{'mean':>9}{'p50':>9}{'p99':>9}{'max':>9}{'steps':>8}{'warm-up':>9}"]
        for name, s in self.stages.items():
            shown = name if "." not in name else "  of it " + name.partition(".")[2]
            warm_up = self.warm_up_ms.get(name, 0.0)
            rows.append(
                f"{shown:16}{s.mean_ms:9.2f}{s.p50_ms:9.2f}{s.p99_ms:9.2f}{s.max_ms:9.2f}"
                f"{s.steps:8}{warm_up:9.0f}"
            )
        return "\n".join([*rows, self.verdict])

    @property
    def verdict(self) -> str:
        """Whether the budget was kept, and where the time went, in one line."""
        if self.blame is None:
            return f"budget {self.budget_ms:.0f} ms: no step yet beyond the warm-up"
        return (
            f"budget {self.budget_ms:.0f} ms: {self.over_budget} of {self.steps} steps over it "
            f"({self.over_budget_share:.1%}); most time in {self.blame} ({self.blame_share:.0%})"
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
        """What `as_dict` made; ``source`` names the file in errors.

        Raises:
            ResultError: something else.
        """
        try:
            period_s, warm_up_s = float(stored["period_s"]), dict(stored["warm_up_s"])
            return cls(period_s, [dict(step) for step in stored["steps"]], warm_up_s)
        except (KeyError, TypeError, ValueError) as error:
            raise ResultError(source, "content", repr(error), "times of a scene") from error

    @classmethod
    def joined(cls, parts: Sequence[StepTimes]) -> Self:
        """Of several scenes: the shortest period, every step, the longest warm-up of a stage."""
        stages = {stage for part in parts for stage in part.warm_up_s}
        longest_s = {s: max(part.warm_up_s.get(s, 0.0) for part in parts) for s in stages}
        steps = [step for part in parts for step in part.steps]
        return cls(min(part.period_s for part in parts), steps, longest_s)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, to be stored."""
        return asdict(self)

    def report(self) -> LatencyReport:
        """What the steps amount to."""
        times = {s: [t[s] for t in self.steps if s in t] for s in _in_order(self.warm_up_s)}
        late = [step for step in self.steps if step[TOTAL] > self.period_s]
        blame, share = _blame(late or self.steps)
        return LatencyReport(
            budget_ms=1e3 * self.period_s,
            steps=len(self.steps),
            stages={stage: StageLatency.of(seconds) for stage, seconds in times.items() if seconds},
            over_budget=len(late),
            blame=blame,
            blame_share=share,
            warm_up_ms={stage: 1e3 * spent_s for stage, spent_s in self.warm_up_s.items()},
        )


class LatencyLog:
    """Keeps the times of the last steps, so a vehicle can run for days in bounded memory."""

    def __init__(self, rate_hz: float, window: int = 36_000) -> None:
        """``rate_hz`` of the sweeps; ``window`` steps are kept: an hour at 10 Hz.

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
        """Takes in one step: seconds by stage, ``total`` among them."""
        if seconds.keys() <= self._warm_up_s.keys():
            self._steps.append(dict(seconds))
            return
        for stage, spent_s in seconds.items():
            self._warm_up_s[stage] = self._warm_up_s.get(stage, 0.0) + spent_s

    def times(self, period_s: float | None = None) -> StepTimes:
        """The kept steps; ``period_s`` between two sweeps, by default that of the rate."""
        return StepTimes(period_s or self._budget_s, list(self._steps), dict(self._warm_up_s))

    def report(self) -> LatencyReport:
        """What the kept steps amount to."""
        return self.times().report()


ORDER = ("flow", "objects", "velocity", "tracker")


def _in_order(stages: Iterable[str]) -> list[str]:
    """Stages in the order of a step, each followed by its parts; the total comes last."""
    found = list(dict.fromkeys(stages))
    names = [s for s in found if "." not in s and s != TOTAL]
    names.sort(key=lambda s: ORDER.index(s) if s in ORDER else len(ORDER))
    parts = {s: [p for p in found if p.startswith(f"{s}.")] for s in names}
    return [name for s in names for name in (s, *parts[s])] + [TOTAL]


def _blame(steps: list[dict[str, float]]) -> tuple[str | None, float]:
    totals: dict[str, float] = {}
    for step in steps:
        for stage, spent_s in step.items():
            totals[stage] = totals.get(stage, 0.0) + spent_s
    whole = totals.pop(TOTAL, 0.0)
    stages = {s: t for s, t in totals.items() if "." not in s}
    if not stages:
        return None, 0.0
    worst = max(stages, key=lambda s: stages[s])
    return worst, stages[worst] / whole

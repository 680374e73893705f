"""Plots of values with intervals, one series per run, drawn as SVG by templates/panels.j2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT = 440.0, 250.0
LEFT, RIGHT, TOP, BOTTOM = 48.0, 12.0, 10.0, 40.0
TICKS = 4
"""Intervals of the vertical axis: five lines are readable at this height."""
BESIDE_PX = 5.0
"""Between the bars of two runs in one bin, so that both are seen."""
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
"""Steps of an axis that people count in, times a power of ten."""


@dataclass(frozen=True)
class Value:
    """A point of a series."""

    at: float
    """On the horizontal axis."""
    value: float
    """NaN where there is none."""
    interval: tuple[float, float]
    """NaN where there is none."""
    told: str
    """What its tooltip says."""


@dataclass(frozen=True)
class Series:
    """The values of one run."""

    index: int
    """Of the run, which gives it its colour."""
    title: str
    values: Sequence[Value]


@dataclass(frozen=True)
class Mark:
    """A drawn point: places in pixels; the ends of its bar are None where it has none."""

    x: float
    y: float
    ends: tuple[float, float] | None
    told: str


@dataclass(frozen=True)
class Panel:
    """A plot."""

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    ticks: Sequence[tuple[float, str]]
    """Places on the horizontal axis, and their text."""
    x_end: float
    y_end: float
    x_start: float = 0.0
    diagonal: bool = False
    """Whether the line y = x is drawn."""

    @property
    def x_ticks(self) -> list[tuple[float, str]]:
        """Places of the horizontal ticks in pixels, and their text."""
        return [(self.x(at), text) for at, text in self.ticks]

    @property
    def y_ticks(self) -> list[tuple[float, str]]:
        """Places of the horizontal lines in pixels, and their text."""
        step = self.y_end / TICKS
        return [(self.y(k * step), f"{k * step:g}") for k in range(TICKS + 1)]

    def x(self, at: float) -> float:
        """Return the place in pixels from the left."""
        share = (at - self.x_start) / (self.x_end - self.x_start)
        return LEFT + share * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        """Return the place in pixels from the top; values beyond the axis lie on its end."""
        share = min(max(value / self.y_end, 0.0), 1.0)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)

    def marks(self, series: Series) -> list[Mark]:
        """Return the points of a series that exist."""
        shift = BESIDE_PX * (self.series.index(series) - (len(self.series) - 1) / 2)
        found = []
        for value in series.values:
            if value.value == value.value:
                low, high = value.interval
                ends = None if low != low else (self.y(low), self.y(high))
                place = self.x(value.at) + shift
                found.append(Mark(place, self.y(value.value), ends, value.told))
        return found

    def path(self, series: Series) -> str:
        """Return the points of the line of a series."""
        return " ".join(f"{m.x:.1f},{m.y:.1f}" for m in self.marks(series))


def round_end(values: Sequence[float]) -> float:
    """Return a round number, a multiple of `TICKS` steps, that is no less than any value.

    >>> round_end([0.3, 0.71]), round_end([17.0])
    (0.8, 20.0)
    """
    known = [value for value in values if np.isfinite(value)]
    most = max([*known, 1e-9])
    power = 10.0 ** np.floor(np.log10(most / TICKS))
    step = next(s * power for s in ROUND_STEPS if s * power * TICKS >= most * (1 - 1e-9))
    return float(f"{step * TICKS:.6g}")

"""Capability curves of runs or submissions as plots of the report."""

from __future__ import annotations

from collections.abc import Mapping

from mottrack.eval.capabilities.curves import CAPABILITIES, Capability, Curves, Point
from mottrack.report.panels import Panel, Series, Value, round_end

MOST_ABOVE = 1.5
"""Intervals are shown up to so many times the largest value."""


def capability_panels(curves: Mapping[str, Curves]) -> list[Panel]:
    """Return a plot for each curve that any run has; runs are numbered in their order."""
    names = [name for name in CAPABILITIES if any(name in run for run in curves.values())]
    return [_panel(name, curves) for name in names]


def _panel(name: str, curves: Mapping[str, Curves]) -> Panel:
    capability = CAPABILITIES[name]
    series = [
        Series(index, title, [_value(k, p, capability) for k, p in enumerate(run[name])])
        for index, (title, run) in enumerate(curves.items())
        if name in run
    ]
    share = capability.value.startswith("share")
    values = [p.value for one in series for p in one.values if p.value == p.value]
    ends = [p.interval[1] for one in series for p in one.values]
    # a wide interval of a rare bin must not press all curves to the floor: its bar is cut off
    reached = [*values, *(end for end in ends if end < MOST_ABOVE * max(values, default=0.0))]
    bins = len(capability.edges) - 1
    return Panel(
        title=capability.title,
        x_label=capability.condition if capability.cumulative else f"{capability.condition}, from",
        y_label=capability.value,
        series=series,
        ticks=[(float(k), f"{capability.edges[k]:g}") for k in range(bins)],
        x_start=-0.5,
        x_end=bins - 0.5,
        y_end=1.0 if share else round_end(reached),
    )


def _value(place: int, point: Point, capability: Capability) -> Value:
    low, high = point.interval
    interval = "" if low != low else f" [{low:.3f}, {high:.3f}]"
    told = f"{capability.bin_name(point)}: {point.value:.3f}{interval}, {point.events} events"
    return Value(float(place), point.value, point.interval, told)

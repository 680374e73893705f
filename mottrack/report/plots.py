"""Plots of comparisons for programs and notebooks: each returns matplotlib axes."""

from __future__ import annotations

from matplotlib import pyplot
from matplotlib.axes import Axes

from mottrack.eval.paired import MetricKey
from mottrack.report.ranking import verdict
from mottrack.runs.comparison import Comparison

COLOURS = {"better": "#0f7b3e", "worse": "#b4231f"}
NEUTRAL = "#8a949d"
"""Of a difference that is not significant."""
VELOCITY = MetricKey("velocity", "all", "mean", "m/s")


def plot_differences(
    comparison: Comparison, key: MetricKey = VELOCITY, axes: Axes | None = None
) -> Axes:
    """Draw each run's difference to its baseline with the 95 % interval; significant ones coloured.

    Args:
        comparison: of at least two runs.
        key: the metric; by default the mean velocity error of the tracks.
        axes: where to draw; None: new ones.
    """
    axes = pyplot.subplots(figsize=(6, 3))[1] if axes is None else axes
    found = [(p, row) for p in comparison.differences for row in p.rows if row.key == key]
    for place, (_, row) in enumerate(found):
        colour = COLOURS.get(verdict(row), NEUTRAL)
        axes.plot([row.low, row.high], [place, place], color=colour, linewidth=2)
        axes.plot([row.difference], [place], "s", color=colour)
    axes.set_yticks(range(len(found)), [part.run for part, _ in found])
    axes.axvline(0.0, color=NEUTRAL, linestyle="--", linewidth=1)
    axes.invert_yaxis()
    towards = "lower" if key.lower_is_better else "higher"
    baseline = found[0][0].baseline if found else "the baseline"
    unit = f", {key.unit}" if key.unit else ""
    name = f"{key.row}, {key.metric}{unit}"
    axes.set_xlabel(f"{name}: difference to {baseline} ({towards} is better)")
    return axes

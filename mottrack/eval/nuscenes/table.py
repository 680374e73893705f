"""The table of an evaluation for a terminal."""

import math

from mottrack.eval.nuscenes.summary import Metrics
from mottrack.formats.text_table import aligned

DECIMALS = {
    "amota": 3, "amotp": 3, "recall": 3, "motar": 3, "mota": 3, "motp": 3, "mt": 0, "ml": 0,
    "faf": 1, "tp": 0, "fp": 0, "fn": 0, "ids": 0, "frag": 0, "tid": 2, "lgd": 2, "gt": 0,
}  # fmt: skip
"""Columns of the table and their digits after the point."""
_UNITS = {"amotp": "m", "motp": "m", "tid": "s", "lgd": "s"}


def format_table(metrics: Metrics) -> str:
    """A line per class, then all classes; "-" where a figure is undefined."""
    head = ["class", *(f"{n} [{_UNITS[n]}]" if n in _UNITS else n for n in DECIMALS)]
    lines = [head]
    for label, figures in (*metrics.classes.items(), ("all", metrics.total)):
        lines.append([label, *(_cell(figures[name], name) for name in DECIMALS)])
    rows = aligned(lines).splitlines()
    rule = "-" * len(rows[0])
    note = (
        f"interpolation of gaps: {metrics.rules.interpolation}. Counts are those at the level of "
        "best MOTA; of gt, the last line has the mean."
    )
    return "\n".join([rows[0], rule, *rows[1:-1], rule, rows[-1], note])


def _cell(value: float, name: str) -> str:
    if math.isnan(value):
        return "-"
    decimals = 1 if name == "gt" and value != round(value) else DECIMALS[name]
    return f"{value:.{decimals}f}"

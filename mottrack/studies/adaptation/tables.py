"""Tables of an adaptation: figures before and after."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

from mottrack.flow.pillarflow.training.validation import Scores
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.studies.adaptation.judgement import Verdict

WORDS = {True: ", better", False: ", worse", None: ""}
"""What a paired interval says."""


class _Shown(NamedTuple):
    """A score as the table shows it."""

    text: str
    factor: float
    """From the score's unit to that of the text."""


SHOWN = {
    "dynamic_rmse": _Shown("dynamic: RMSE, m/s", 1.0),
    "dynamic_median": _Shown("dynamic: median, m/s", 1.0),
    "within_1_mps": _Shown("dynamic: within 1 m/s, %", 100.0),
    "static_rmse": _Shown("static: RMSE, m/s", 1.0),
    "static_over_1_mps": _Shown("static: over 1 m/s, %", 100.0),
}
"""Rows of the table of the embedded world, by the name of the score."""


def figure_table(verdict: Verdict) -> TextTable:
    """Tabulate the figures without labels on the held-out stretches."""
    rows: list[tuple[Cell, ...]] = []
    for name, found in verdict.fields.items():
        for row in found:
            known = row.low == row.low
            half = f" ± {row.high - row.difference:.3f}" if known else ""
            change = f"{row.difference:+.3f}{half}{WORDS[row.better]}"
            rows.append((name, row.key.title, row.baseline, row.value, change))
    heads = ("field", "figure", "before", "after", "difference")
    title = f"Without labels, {verdict.stretches} held-out stretches of the logs"
    note = "± is half the 95 % interval of the paired difference over stretches"
    return TextTable("adapted", title, tuple(Column(head) for head in heads), tuple(rows), note)


def world_table(before: Scores, after: Scores) -> TextTable:
    """Tabulate the errors on held-out pairs of the embedded world, network alone."""
    old, new = asdict(before), asdict(after)
    rows: list[tuple[Cell, ...]] = [
        (shown.text, shown.factor * old[name], shown.factor * new[name])
        for name, shown in SHOWN.items()
    ]
    heads = ("error", "before", "after")
    title = "Embedded world, held-out pairs with truth"
    return TextTable("world", title, tuple(Column(head) for head in heads), tuple(rows))

"""Calibration of one run or several as JSON, a table and reliability diagrams."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.storage import write_text
from mottrack.eval.paired import CONFIDENCE
from mottrack.eval.slices.calibration import Calibration
from mottrack.eval.slices.report import interval_text
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables

Found = Mapping[str, list[Calibration] | str]
"""Run to its calibrations, or to why there is none."""


def write_outputs(folder: Path, found: Found) -> list[TextTable]:
    """Write `calibration.json`, the table and `calibration.png`; return the table."""
    content = {name: run if isinstance(run, str) else _plain(run) for name, run in found.items()}
    text = json.dumps(strict(content), indent=1, allow_nan=False)
    write_text(folder / "calibration.json", text)
    table = calibration_table(found)
    write_tables([table], folder / "tables")
    _draw(folder / "calibration.png", found)
    return [table]


def calibration_table(found: Found) -> TextTable:
    """Return a line per run and class: boxes, share that is right, mean score, error."""
    rows: list[tuple[Cell, ...]] = []
    for name, run in found.items():
        for one in () if isinstance(run, str) else run:
            boxes = np.array([b.boxes for b in one.bins], np.float64)
            score = np.nansum([b.score * b.boxes for b in one.bins]) / boxes.sum()
            right = np.nansum([b.right.value * b.boxes for b in one.bins]) / boxes.sum()
            rows.append((name, one.label, one.boxes, right, score, interval_text(one.error)))
    heads = ("run", "class", "track boxes", "share right", "mean score", "ECE")
    why = [f"{name}: {run}" for name, run in found.items() if isinstance(run, str)]
    note = f"ECE: expected calibration error, lower is better; {CONFIDENCE:.0%} intervals."
    columns = tuple(Column(head) for head in heads)
    note = ". ".join([note.rstrip("."), *why]) + "."
    return TextTable("calibration", "Calibration of the scores", columns, tuple(rows), note)


def _plain(run: list[Calibration]) -> list[dict[str, Any]]:
    return [
        {
            "class": one.label,
            "boxes": one.boxes,
            "ece": _interval(one.error),
            "bins": [
                {
                    "low": b.low,
                    "high": b.high,
                    "boxes": b.boxes,
                    "score": b.score,
                    "right": _interval(b.right),
                }
                for b in one.bins
            ],
        }
        for one in run
    ]


def _interval(found: Any) -> dict[str, float]:
    low, high = found.interval()
    return {"value": found.value, "low": low, "high": high}


def _draw(path: Path, found: Found) -> None:
    """Draw a reliability diagram for each run: share that is right over the mean score."""
    from matplotlib.figure import Figure  # slow to import

    shown = {name: run for name, run in found.items() if not isinstance(run, str)}
    if not shown:
        return
    figure = Figure(figsize=(4.2 * len(shown), 4.0), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    for axis, (name, run) in zip(axes, shown.items(), strict=True):
        _panel(axis, name, run)
    figure.savefig(path, dpi=110)


def _panel(axis: Any, name: str, run: list[Calibration]) -> None:
    axis.plot([0, 1], [0, 1], "--", color="0.6", lw=1, label="calibrated")
    whole = run[0]
    bins = [b for b in whole.bins if b.boxes]
    score, right = ([getattr(b, key) for b in bins] for key in ("score", "right"))
    value = np.array([one.value for one in right])
    ends = np.array([one.interval() for one in right]).reshape(-1, 2)
    reach = np.nan_to_num(np.abs(ends - value[:, None])).T
    axis.errorbar(score, value, yerr=reach, fmt="o-", ms=4, lw=1.6, capsize=2, label=whole.label)
    for one in run[1:]:
        points = [(b.score, b.right.value) for b in one.bins if b.boxes]
        axis.plot(*zip(*points, strict=True), "-", lw=0.8, alpha=0.7, label=one.label)
    axis.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="mean score of the bin", ylabel="share right")
    axis.set_title(f"{name}, ECE {whole.error.value:.3f}", fontsize=10)
    axis.legend(fontsize=7)
    axis.grid(alpha=0.3)

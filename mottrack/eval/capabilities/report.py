"""Curves of one run or several as JSON, tables and a picture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.storage import write_text
from mottrack.eval.capabilities.curves import CAPABILITIES, Curves, Point
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables

COLUMNS = 3
"""Panels side by side."""


def write_outputs(folder: Path, runs: Mapping[str, Curves]) -> list[TextTable]:
    """Write `capabilities.json`, the tables and `capabilities.png`; return the tables."""
    content = {
        run: {n: [p._asdict() for p in c] for n, c in cs.items()} for run, cs in runs.items()
    }
    plain: Any = json.loads(json.dumps(content), parse_constant=float)  # tuples become lists
    write_text(folder / "capabilities.json", json.dumps(strict(plain), indent=1, allow_nan=False))
    tables = [_table(name, runs) for name in CAPABILITIES if any(name in c for c in runs.values())]
    write_tables(tables, folder / "tables")
    _draw(runs, folder / "capabilities.png")
    return tables


def _table(name: str, runs: Mapping[str, Curves]) -> TextTable:
    """Return a line per bin: every run's mean with its interval, and how many events it has."""
    capability = CAPABILITIES[name]
    shown = {run: curves[name] for run, curves in runs.items() if name in curves}
    columns = [Column(capability.condition)]
    columns += [Column(text) for run in shown for text in (run, "events")]
    rows: list[tuple[Cell, ...]] = []
    for k, place in enumerate(next(iter(shown.values()))):
        points = [curve[k] for curve in shown.values()]
        cells = [cell for p in points for cell in (_text(p), p.events)]
        rows.append((capability.bin_name(place), *cells))
    title = f"{capability.title}: {capability.value}"
    return TextTable(name, title, tuple(columns), tuple(rows), "95 % intervals over scenes.")


def _text(point: Point) -> str:
    if np.isnan(point.value):
        return "–"
    low, high = point.interval
    return f"{point.value:.3f}" if np.isnan(low) else f"{point.value:.3f} [{low:.3f}, {high:.3f}]"


def _draw(runs: Mapping[str, Curves], path: Path) -> None:
    from matplotlib.figure import Figure  # slow to import

    names = [name for name in CAPABILITIES if any(name in c for c in runs.values())]
    if not names:
        return
    rows = -(-len(names) // COLUMNS)
    figure = Figure(figsize=(5.2 * COLUMNS, 3.4 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, COLUMNS)).ravel()
    for axis in axes[len(names) :]:
        axis.set_visible(False)
    for axis, name in zip(axes, names, strict=False):
        _panel(axis, name, runs)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4) or 1)
    figure.savefig(path, dpi=110)


def _panel(axis: Any, name: str, runs: Mapping[str, Curves]) -> None:
    capability = CAPABILITIES[name]
    for k, (run, curves) in enumerate(runs.items()):
        points = curves.get(name, [])
        value = np.array([p.value for p in points])
        ends = np.array([p.interval for p in points]).reshape(-1, 2)
        reach = np.nan_to_num(np.abs(ends - value[:, None])).T
        place = np.arange(len(points)) + 0.08 * k  # beside each other, so that bars can be told
        axis.errorbar(place, value, yerr=reach, fmt="o-", ms=4, lw=1.4, capsize=2, label=run)
    edges = capability.edges
    axis.set_xticks(range(len(edges) - 1), [f"{e:g}" for e in edges[:-1]])
    suffix = "" if capability.cumulative else ", from"
    axis.set_xlabel(f"{capability.condition}{suffix}")
    axis.set_ylabel(capability.value)
    axis.set_title(capability.title, fontsize=10)
    if capability.value.startswith("share"):
        axis.set_ylim(0, 1.05)
    else:
        axis.set_ylim(bottom=0)
    axis.grid(alpha=0.3)

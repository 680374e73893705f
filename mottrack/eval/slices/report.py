"""Slices of one run or several as JSON and tables, with paired differences to the first."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mottrack.core.storage import write_text
from mottrack.eval.paired import CONFIDENCE, PairedDifference, Sampled, draw, paired
from mottrack.eval.slices.figures import FIGURES, Slice, figure_key, slices
from mottrack.eval.tracked_scenes import TrackedScenes
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import MISSING, Cell, Column, TextTable, write_tables

DEFAULT_COLUMNS = ("class", "range", "speed", "points", "occlusion")
"""What every data set has; a slice by scene is long."""


@dataclass(frozen=True)
class Sliced:
    """The slices of every run, and their differences to the first one."""

    runs: Mapping[str, list[Slice]]
    differences: Mapping[str, dict[str, PairedDifference]]
    """Run to `row/figure` to the difference; none where the scenes are not the same."""

    def difference(self, run: str, column: str, name: str, figure: str) -> PairedDifference | None:
        """Return the difference of a run in one figure of a slice to the first run."""
        key = figure_key(column, name, figure)
        return self.differences.get(run, {}).get(f"{key.row}/{figure}")


def sliced(runs: Mapping[str, TrackedScenes], by: Sequence[str], resamples: int) -> Sliced:
    """Return the slices of all runs by all columns.

    Raises:
        ConfigError: a column is not known.
    """
    found = {
        name: slices(scenes, by, draw(len(scenes.results), resamples))
        for name, scenes in runs.items()
    }
    names = {name: [result.name for result in run.results] for name, run in runs.items()}
    first = next(iter(runs))
    same = [name for name in runs if name != first and names[name] == names[first]]
    return Sliced(found, {name: _differences(found[first], found[name]) for name in same})


def _differences(baseline: Sequence[Slice], run: Sequence[Slice]) -> dict[str, PairedDifference]:
    base = {key: sampled for part in baseline for key, sampled in part.figures.items()}
    pairs = [
        paired(key, base[key], sampled)
        for part in run
        for key, sampled in part.figures.items()
        if key in base
    ]
    return {f"{d.key.row}/{d.key.metric}": d for d in pairs}


def write_outputs(folder: Path, found: Sliced) -> list[TextTable]:
    """Write `slices.json` and a table for each column; return the tables."""
    content = {
        name: [
            {"column": s.column, "slice": s.name, "true_boxes": s.boxes, **_numbers(s)} for s in run
        ]
        for name, run in found.runs.items()
    }
    differences = {
        name: {key: d.as_dict() for key, d in rows.items()}
        for name, rows in found.differences.items()
    }
    plain = strict({"slices": content, "differences": differences})
    write_text(folder / "slices.json", json.dumps(plain, indent=1, allow_nan=False))
    tables = slice_tables(found)
    write_tables(tables, folder / "tables")
    return tables


def slice_tables(found: Sliced) -> list[TextTable]:
    """Return a table for each column: a line per slice and run, every figure with its interval."""
    columns = dict.fromkeys(part.column for run in found.runs.values() for part in run)
    return [_table(found, column) for column in columns]


def _table(found: Sliced, column: str) -> TextTable:
    rows: list[tuple[Cell, ...]] = []
    names = dict.fromkeys(
        part.name for run in found.runs.values() for part in run if part.column == column
    )
    several = len(found.runs) > 1
    for name in names:
        for title, run in found.runs.items():
            part = next((p for p in run if (p.column, p.name) == (column, name)), None)
            if part is not None:
                cells = (_cell(found, title, part, figure) for figure in FIGURES)
                rows.append((name, *((title,) if several else ()), part.boxes, *cells))
    heads = [column, *(("run",) if several else ()), "true boxes"]
    heads += [name + (f" [{unit}]" if (unit := _unit(name)) else "") for name in FIGURES]
    note = f"In brackets {CONFIDENCE:.0%} intervals over scenes" + (
        "; * differs significantly from the first run, on the same scenes." if several else "."
    )
    safe = "".join(c if c.isalnum() else "_" for c in column)
    columns = tuple(Column(head) for head in heads)
    return TextTable(f"slices_{safe}", f"By {column}", columns, tuple(rows), note)


def _unit(figure: str) -> str:
    return figure_key("", "", figure).unit


def _cell(found: Sliced, run: str, part: Slice, figure: str) -> str:
    sampled = part.figures.get(figure_key(part.column, part.name, figure))
    difference = found.difference(run, part.column, part.name, figure)
    mark = "*" if difference is not None and difference.significant else ""
    return f"{interval_text(sampled)}{mark}"


def interval_text(found: Sampled | None) -> str:
    """Return a figure with its interval to three decimals, a dash where there is none."""
    if found is None or found.value != found.value:
        return MISSING
    low, high = found.interval()
    return f"{found.value:.3f}" if low != low else f"{found.value:.3f} [{low:.3f}, {high:.3f}]"


def _numbers(part: Slice) -> dict[str, Any]:
    content = {}
    for key, sampled in part.figures.items():
        low, high = sampled.interval()
        content[key.metric] = {"value": sampled.value, "low": low, "high": high}
    return content

"""Tables and files of a scene flow evaluation of one method or several."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import I64
from mottrack.core.storage import write_text
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, Sampled, draw
from mottrack.eval.sceneflow.categories import GROUPS
from mottrack.eval.sceneflow.figures import COMPARED, HEADLINE, SceneSums, differences, key_of
from mottrack.eval.sceneflow.sums import SUMS
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import MISSING, Cell, Column, TextTable, aligned, write_tables

Methods = Mapping[str, SceneSums]
"""Name of a method to its sums, the same scenes for all; the first is the baseline."""


def write_outputs(folder: Path, methods: Methods, resamples: int = RESAMPLES) -> list[TextTable]:
    """Write `sceneflow.json` and the tables; return the tables.

    Args:
        folder: where to.
        methods: what was evaluated.
        resamples: of the scenes, for the intervals; with one scene there is none.
    """
    scenes = len(next(iter(methods.values())).scenes)
    weights = draw(scenes, resamples)
    content = {name: _figures(sums, weights) for name, sums in methods.items()}
    plain = {"scenes": scenes, "resamples": resamples, "methods": content}
    plain["differences"] = _differences(methods, weights)
    write_text(folder / "sceneflow.json", json.dumps(strict(plain), indent=1, allow_nan=False))
    tables = [_headline(methods, weights), *_compared(methods, weights)]
    tables += [_rows(name, s) for name, s in methods.items()]
    write_tables(tables, folder / "tables")
    return tables


def _figures(sums: SceneSums, weights: I64) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, sampled in sums.sampled(weights).items():
        low, high = sampled.interval()
        numbers = {"value": sampled.value, "low": low, "high": high}
        content.setdefault(key.row, {})[key.metric] = numbers
    return content


def _differences(methods: Methods, weights: I64) -> dict[str, Any]:
    names = list(methods)
    if len(names) < 2:
        return {}
    baseline = methods[names[0]].sampled(weights)
    return {
        name: {
            f"{d.key.row}/{d.key.metric}": d.as_dict()
            for d in differences(baseline, methods[name].sampled(weights))
        }
        for name in names[1:]
    }


def _compared(methods: Methods, weights: I64) -> list[TextTable]:
    """Return a line per method after the first and figure: the paired difference to the first."""
    names = list(methods)
    if len(names) < 2:
        return []
    baseline, shown = methods[names[0]].sampled(weights), {key_of(*place) for place in COMPARED}
    signed = tuple(Column(text, 4, signed=True) for text in ("difference", "low", "high"))
    columns = (Column("method"), Column("figure"), *signed, Column("significance"))
    rows: list[tuple[Cell, ...]] = []
    for name in names[1:]:
        for d in differences(baseline, methods[name].sampled(weights)):
            if d.key in shown:
                word = {True: "better", False: "worse", None: "not significant"}[d.better]
                verdict = word if d.low == d.low else "no interval"
                figure = f"{d.key.row}: {d.key.metric}"
                rows.append((name, figure, d.difference, d.low, d.high, verdict))
    note = f"Paired over scenes, {CONFIDENCE:.0%} intervals; sceneflow.json has every figure."
    title = f"Scene flow, difference to {names[0]}"
    return [TextTable("sceneflow_differences", title, columns, tuple(rows), note)]


def _headline(methods: Methods, weights: I64) -> TextTable:
    """Return a line per method: the ranking figures with their intervals."""
    columns = (Column("method"), *(Column(f"{t}: {n}") for t, n in HEADLINE))
    rows: list[tuple[Cell, ...]] = []
    for name, sums in methods.items():
        sampled = sums.sampled(weights)
        rows.append((name, *(interval_text(sampled.get(key_of(*key))) for key in HEADLINE)))
    note = (
        "Errors: lower is better. EPE in m per pair of sweeps; the dynamic error is a share of the "
        f"speed. In brackets {CONFIDENCE:.0%} intervals over scenes."
    )
    return TextTable("sceneflow", "Scene flow", columns, tuple(rows), note)


def interval_text(found: Sampled | None) -> str:
    """Return a figure with its interval, a dash where there is none."""
    if found is None or np.isnan(found.value):
        return MISSING
    low, high = found.interval()
    return f"{found.value:.4f}" if np.isnan(low) else f"{found.value:.4f} [{low:.4f}, {high:.4f}]"


def _rows(name: str, sums: SceneSums) -> TextTable:
    """Return a line per range, speed and class of one method, then the groups' figures."""
    whole, values = sums.whole, sums.values()
    columns = ("row", "points", "strict", "relaxed", "angle [rad]", "EPE [m]")
    rows: list[tuple[Cell, ...]] = [
        (row, int(counted[0]), *(values[row, key] for key in SUMS[1:]))
        for row, counted in whole.rows.items()
    ]
    for group in GROUPS:
        for kind in ("static", "dynamic") if ("bucketed", f"{group} static") in values else ():
            value = values["bucketed", f"{group} {kind}"]
            rows.append((f"bucketed {group} {kind}", None, None, None, None, value))
    note = "The dynamic figures of the last rows are shares of the speed, not metres."
    heads = tuple(Column(c, 4) for c in columns)
    safe = "".join(c if c.isalnum() else "_" for c in name)
    return TextTable(f"sceneflow_{safe}", f"Scene flow, {name}", heads, tuple(rows), note)


def format_tables(tables: Sequence[TextTable]) -> str:
    """Return all tables for a terminal."""
    texts = []
    for table in tables:
        lines = aligned([[c.name for c in table.columns], *table.texts()])
        texts.append(f"{table.title}\n{lines}\n{table.note}")
    return "\n\n".join(texts)

"""The evaluation as files and as a table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.storage import write_text
from mottrack.eval.argoverse2.metrics import FIGURES, CategoryMetrics, mean_over_categories
from mottrack.eval.argoverse2.rules import Argoverse2Rules, Objective
from mottrack.eval.paired import CONFIDENCE, draw, sample, t_interval
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables

Metrics = Mapping[str, CategoryMetrics]
MEAN = "mean"
"""Name of the row of the categories that have truth."""


def write_outputs(
    folder: Path, metrics: Metrics, rules: Argoverse2Rules, objective: Objective, resamples: int
) -> TextTable:
    """Write `argoverse2.json` and the table; return the table.

    Args:
        folder: where to.
        metrics: of every category.
        rules: by which they were made.
        objective: what the threshold of the details is chosen for.
        resamples: of the logs for the intervals; 0 for none.
    """
    logs = len(next(iter(metrics.values())).levels[0].hota)
    weights = draw(logs, resamples) if resamples else None
    intervals = {} if weights is None else _intervals(metrics, weights)
    content = {
        "rules": {name: getattr(rules, name) for name in rules.__dataclass_fields__},
        "logs": logs,
        "objective": objective,
        "resamples": resamples,
        "categories": {name: _plain(m, objective) for name, m in metrics.items()},
        MEAN: _means(metrics),
        "intervals": intervals,
    }
    write_text(folder / "argoverse2.json", json.dumps(strict(content), indent=1, allow_nan=False))
    table = _table(metrics, objective, intervals)
    write_tables([table], folder / "tables")
    return table


def _plain(metrics: CategoryMetrics, objective: Objective) -> dict[str, Any]:
    return {
        **metrics.figures(),
        f"at_best_{objective}": metrics.at(metrics.best(objective)),
        "score_thresholds": metrics.thresholds.tolist(),
    }


def _means(metrics: Metrics) -> dict[str, float]:
    """Return the means over the categories that have truth, and over all, as the package's."""
    every = [m.figures() for m in metrics.values()]
    scored = [m.figures() for m in metrics.values() if m.truth]
    means = {name: float(np.mean([f[name] for f in scored])) for name in FIGURES}
    means |= {f"{name}_all": float(np.mean([f[name] for f in every])) for name in FIGURES}
    return means


def _intervals(metrics: Metrics, weights: I64) -> dict[str, dict[str, list[float]]]:
    rows: dict[str, dict[str, list[float]]] = {MEAN: {}}
    for figure in FIGURES:
        for name, m in metrics.items():
            if m.truth:
                interval = sample(m.metric(figure), weights).interval()
                rows.setdefault(name, {})[figure] = list(interval)
        mean = mean_over_categories(dict(metrics), figure)
        whole = float(mean(np.ones((1, weights.shape[1]), np.int64))[0])
        draws: F64 = mean(weights)
        rows[MEAN][figure] = list(t_interval(whole, draws, weights.shape[1]))
    return rows


def _table(
    metrics: Metrics, objective: Objective, intervals: dict[str, dict[str, list[float]]]
) -> TextTable:
    heads = ("HOTA", "MOTA", "AMOTA", "DetA", "AssA")
    counts = ("tp", "fp", "fn", "ids", "frag")
    columns = (Column("category"), *(Column(h, 4) for h in heads), *(Column(c, 0) for c in counts))
    rows: list[tuple[Cell, ...]] = []
    for name, m in metrics.items():
        if m.truth:
            figures, at = m.figures(), m.at(m.best(objective))
            best = [_text(figures[f], intervals.get(name, {}).get(f)) for f in FIGURES[:3]]
            rows.append((name, *best, at["det_a"], at["ass_a"], *(at[c] for c in counts)))
    means = _means(metrics)
    best = [_text(means[f], intervals.get(MEAN, {}).get(f)) for f in FIGURES[:3]]
    rows.append((MEAN, *best, *(7 * [None])))
    note = (
        "Best of the score thresholds; AMOTA is the mean of MOTA over them. DetA, AssA and counts "
        f"are those at the threshold of the best {objective.upper()}. Categories without truth are "
        "left out here and in the mean."
    )
    if intervals:
        note += f" In brackets {CONFIDENCE:.0%} intervals over logs, the thresholds kept."
    return TextTable("argoverse2", "Argoverse 2 tracking", columns, tuple(rows), note)


def _text(value: float, interval: list[float] | None) -> str:
    if interval is None or np.isnan(interval[0]):
        return f"{value:.4f}"
    return f"{value:.4f} [{interval[0]:.4f}, {interval[1]:.4f}]"

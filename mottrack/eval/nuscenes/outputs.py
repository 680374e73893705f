"""Files, table and picture of an evaluation: the official JSON, strict JSON, CSV, recall curves."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes.metrics import Metrics
from mottrack.eval.nuscenes.rules import COLORS, LEVEL_METRICS, SUMMARY_METRICS
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, aligned, to_csv

DECIMALS = {
    "amota": 3, "amotp": 3, "recall": 3, "motar": 3, "mota": 3, "motp": 3, "mt": 0, "ml": 0,
    "faf": 1, "tp": 0, "fp": 0, "fn": 0, "ids": 0, "frag": 0, "tid": 2, "lgd": 2, "gt": 0,
}  # fmt: skip
"""Columns of the table and their digits after the point."""
_UNITS = {"amotp": "m", "motp": "m", "tid": "s", "lgd": "s"}
PANELS = {
    "motar": "MOTAR", "mota": "MOTA", "motp": "MOTP [m]", "recall": "recall",
    "faf": "false positives\nper 100 frames", "ids": "identity switches", "frag": "fragmentations",
    "fn": "misses", "tid": "time to first hit [s]", "lgd": "longest gap [s]",
    "mt": "mostly tracked", "ml": "mostly lost",
}  # fmt: skip
"""Metric to the title of its panel."""


def summary_json(metrics: Metrics, meta: dict[str, Any], eval_time_s: float) -> dict[str, Any]:
    """Return the content of metrics_summary.json, with the interpolation named beside it."""
    by_metric = {
        name: {label: row[name] for label, row in metrics.classes.items()}
        for name in SUMMARY_METRICS
    }
    return {
        "label_metrics": by_metric,
        "eval_time": eval_time_s,
        "cfg": metrics.rules.as_official_config(),
        **metrics.total,
        "meta": meta,
        "interpolation": metrics.rules.interpolation,
    }


def details_json(metrics: Metrics) -> dict[str, Any]:
    """Return the content of metrics_details.json, with the interpolation named in each class."""
    names = ("confidence", "recall_hypo", *LEVEL_METRICS)
    return {
        label: {name: curves[name].tolist() for name in names}
        | {"interpolation": metrics.rules.interpolation}
        for label, curves in metrics.curves.items()
    }


def write_outputs(
    folder: Path, metrics: Metrics, meta: dict[str, Any], eval_time_s: float
) -> list[Path]:
    """Write both official files (with NaN, as the official code does), strict JSON, and CSV."""
    contents = {
        "metrics_summary": summary_json(metrics, meta, eval_time_s),
        "metrics_details": details_json(metrics),
    }
    texts = {"metrics.csv": summary_csv(metrics)}
    for name, content in contents.items():
        texts[f"{name}.json"] = json.dumps(content, indent=2)
        texts[f"{name}.strict.json"] = json.dumps(strict(content), indent=2, allow_nan=False)
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in sorted(texts)]


def summary_csv(metrics: Metrics) -> str:
    """Return a line per class and one for all, a column per metric; empty where undefined."""
    columns = [Column(name) for name in ("class", "interpolation", *SUMMARY_METRICS)]
    rows: list[tuple[Cell, ...]] = [
        (label, metrics.rules.interpolation, *(row[name] for name in SUMMARY_METRICS))
        for label, row in metrics.by_class().items()
    ]
    return to_csv(TextTable("metrics", "", tuple(columns), tuple(rows)))


def format_table(metrics: Metrics) -> str:
    """Return a line per class, then all classes; "-" where a metric is undefined."""
    head = ["class", *(f"{n} [{_UNITS[n]}]" if n in _UNITS else n for n in DECIMALS)]
    lines = [head]
    for label, row in metrics.by_class().items():
        lines.append([label, *(_cell(row[name], name) for name in DECIMALS)])
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


def draw_recall_curves(metrics: Metrics, path: Path) -> None:
    """Draw twelve metrics over recall, a line per class, and mark the level of best MOTA."""
    from matplotlib.figure import Figure  # slow to import, and drawn only on request

    figure = Figure(figsize=(15, 9.5), layout="constrained")
    axes = figure.subplots(3, 4, sharex=True)
    for axis, (name, title) in zip(axes.flat, PANELS.items(), strict=True):
        for label, curves in metrics.curves.items():
            value, recall = curves[name], curves["recall_hypo"]
            reached = ~np.isnan(curves["confidence"])
            if not reached.any():
                continue
            color = COLORS.get(label)
            axis.plot(recall[reached], value[reached], color=color, label=label, lw=1.5)
            best = int(np.nanargmax(curves["mota"]))
            axis.plot(recall[best], value[best], "o", color=color, ms=5)
        axis.set_title(title, fontsize=10)
        axis.set_xlim(0, 1)
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("target recall")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels) or 1)
    total = metrics.total
    figure.suptitle(
        f"AMOTA {total['amota']:.3f}, AMOTP {total['amotp']:.3f} m; interpolation "
        f"{metrics.rules.interpolation}; dots: level of best MOTA"
    )
    figure.savefig(path, dpi=110)

"""Files of an evaluation: the official JSON, strict JSON, CSV."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes.rules import LEVEL_METRICS, SUMMARY_METRICS
from mottrack.eval.nuscenes.summary import Metrics
from mottrack.formats.strict_json import strict


def summary_json(metrics: Metrics, meta: dict[str, Any], eval_time_s: float) -> dict[str, Any]:
    """The content of metrics_summary.json, with the interpolation named beside it."""
    by_metric = {
        name: {label: figures[name] for label, figures in metrics.classes.items()}
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
    """The content of metrics_details.json, with the interpolation named in each class."""
    names = ("confidence", "recall_hypo", *LEVEL_METRICS)
    return {
        label: {name: curves[name].tolist() for name in names}
        | {"interpolation": metrics.rules.interpolation}
        for label, curves in metrics.curves.items()
    }


def write_outputs(
    folder: Path, metrics: Metrics, meta: dict[str, Any], eval_time_s: float
) -> list[Path]:
    """Writes both official files (with NaN, as the official code does), strict JSON, and CSV."""
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
    """A line per class and one for all classes, a column per metric; empty where undefined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["class", "interpolation", *SUMMARY_METRICS])
    for label, figures in (*metrics.classes.items(), ("all", metrics.total)):
        values = [figures[name] for name in SUMMARY_METRICS]
        cells = ["" if math.isnan(value) else repr(value) for value in values]
        writer.writerow([label, metrics.rules.interpolation, *cells])
    return text.getvalue()

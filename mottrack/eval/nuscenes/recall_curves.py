"""Recall curves as a picture: how each metric changes with the recall that is asked for."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mottrack.eval.nuscenes.rules import COLORS
from mottrack.eval.nuscenes.summary import Metrics

PANELS = {
    "motar": "MOTAR", "mota": "MOTA", "motp": "MOTP [m]", "recall": "recall",
    "faf": "false positives\nper 100 frames", "ids": "identity switches", "frag": "fragmentations",
    "fn": "misses", "tid": "time to first hit [s]", "lgd": "longest gap [s]",
    "mt": "mostly tracked", "ml": "mostly lost",
}  # fmt: skip


def draw_recall_curves(metrics: Metrics, path: Path) -> None:
    """Draws twelve metrics over recall, a line per class, and marks the level of best MOTA."""
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
        axis.set_xlabel("recall asked for")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels) or 1)
    total = metrics.total
    figure.suptitle(
        f"AMOTA {total['amota']:.3f}, AMOTP {total['amotp']:.3f} m; interpolation "
        f"{metrics.rules.interpolation}; dots: level of best MOTA"
    )
    figure.savefig(path, dpi=110)

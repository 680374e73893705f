"""The loss curve as a picture and as numbers."""

from __future__ import annotations

import json
from pathlib import Path

from mottrack.flow.pillarflow.training.checkpoint import Progress


def write_curve(progress: Progress, directory: Path) -> None:
    """`curve.json` with every point and `curve.png` with loss and validation errors."""
    (directory / "curve.json").write_text(json.dumps(progress.history, indent=1) + "\n")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    losses = [point for point in progress.history if "loss" in point]
    left.plot([p["step"] for p in losses], [p["loss"] for p in losses], linewidth=0.8)
    left.set(xlabel="step", ylabel="training loss", yscale="log")
    checks = [point for point in progress.history if "dynamic_rmse" in point]
    for name in ("dynamic_rmse", "dynamic_median", "static_rmse"):
        right.plot([p["step"] for p in checks], [p[name] for p in checks], ".-", label=name)
    right.set(xlabel="step", ylabel="held-out error [m/s]", yscale="log")
    right.legend()
    figure.savefig(directory / "curve.png", dpi=120)

"""A whole training run: train, calibrate the covariance, write weights, scores and loss curve."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mottrack.flow.pillarflow.calibration import fit_calibration
from mottrack.flow.pillarflow.training.config import TrainConfig
from mottrack.flow.pillarflow.training.examples import Example
from mottrack.flow.pillarflow.training.trainer import RankInfo, Report, Trainer
from mottrack.flow.pillarflow.training.validation import Scores
from mottrack.flow.pillarflow.weights_file import Weights, save_weights


def run(
    config: TrainConfig,
    out: Path,
    examples: Sequence[Example],
    held_out: Sequence[Example],
    report: Report,
) -> Scores | None:
    """Train from the checkpoint in `out`, if any; the first process returns the scores."""
    rank = RankInfo.join()
    if rank.is_first:
        out.mkdir(parents=True, exist_ok=True)
        (out / "config.json").write_text(config.model_dump_json(indent=1) + "\n")
    trainer = Trainer(config, rank, out)
    trainer.fit(examples, held_out, report)
    scores = finish(trainer, held_out) if rank.is_first else None
    rank.leave()
    return scores


def finish(trainer: Trainer, held_out: Sequence[Example]) -> Scores:
    """Calibrate on the first half of the held-out examples, score on the second, write all."""
    half = len(held_out) // 2
    fitted = fit_calibration(trainer.validate(held_out[:half] if half else held_out).residuals)
    scores = trainer.validate(held_out[half:]).scores(fitted)
    weights = Weights(trainer.averaged().eval(), fitted, trainer.config.examples.remove_ground)
    save_weights(trainer.out / "weights.safetensors", weights)
    progress = trainer.progress
    progress.history.append({"step": float(progress.step), **scores.as_dict()})
    trainer.save()
    summary = {"step": progress.step, "seconds": progress.seconds, **scores.as_dict()}
    (trainer.out / "scores.json").write_text(json.dumps(summary, indent=1) + "\n")
    _write_curve(progress.history, trainer.out)
    return scores


def _write_curve(history: list[dict[str, float]], out: Path) -> None:
    """Write `curve.json` with every point and `curve.png` with loss and validation errors."""
    from matplotlib.figure import Figure

    (out / "curve.json").write_text(json.dumps(history, indent=1) + "\n")
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    losses = [point for point in history if "loss" in point]
    left.plot([p["step"] for p in losses], [p["loss"] for p in losses], linewidth=0.8)
    left.set(xlabel="step", ylabel="training loss", yscale="log")
    checks = [point for point in history if "dynamic_rmse" in point]
    for name in ("dynamic_rmse", "dynamic_median", "static_rmse"):
        right.plot([p["step"] for p in checks], [p[name] for p in checks], ".-", label=name)
    right.set(xlabel="step", ylabel="held-out error [m/s]", yscale="log")
    right.legend()
    figure.savefig(out / "curve.png", dpi=120)

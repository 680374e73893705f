"""A whole training run: train, keep the curve, calibrate the covariance, write the weights."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mottrack.flow.pillarflow.calibration import fit_calibration
from mottrack.flow.pillarflow.training.checkpoint import Progress
from mottrack.flow.pillarflow.training.config import TrainConfig
from mottrack.flow.pillarflow.training.curve import write_curve
from mottrack.flow.pillarflow.training.example import Example
from mottrack.flow.pillarflow.training.parallel import join, leave
from mottrack.flow.pillarflow.training.trainer import Report, Trainer
from mottrack.flow.pillarflow.training.validation import Scores
from mottrack.flow.pillarflow.weights_file import Weights, save_weights


def run(
    config: TrainConfig,
    out: Path,
    examples: Sequence[Example],
    held_out: Sequence[Example],
    report: Report,
) -> Scores | None:
    """Train from where `out` stands; the first process returns the scores, others None."""
    place = join()
    if place.first:
        out.mkdir(parents=True, exist_ok=True)
        (out / "config.json").write_text(config.model_dump_json(indent=1) + "\n")
    trainer = Trainer(config, place, out)
    progress = trainer.fit(examples, held_out, report)
    scores = finish(trainer, progress, held_out, out) if place.first else None
    leave(place)
    return scores


def finish(trainer: Trainer, progress: Progress, held_out: Sequence[Example], out: Path) -> Scores:
    """Calibrate on the first half of the held-out examples, score on the second, write."""
    half = len(held_out) // 2
    fitted = fit_calibration(trainer.validate(held_out[:half] if half else held_out).residuals)
    scores = trainer.validate(held_out[half:]).scores(fitted)
    weights = Weights(trainer.averaged().eval(), fitted, trainer.config.examples.ground)
    save_weights(out / "weights.safetensors", weights)
    progress.history.append({"step": float(progress.step), **scores.as_dict()})
    trainer.save()
    about = {"step": progress.step, "seconds": progress.seconds, **scores.as_dict()}
    (out / "scores.json").write_text(json.dumps(about, indent=1) + "\n")
    write_curve(progress, out)
    return scores

"""Adaptation of the network to a user's own logs: label, train, judge, keep only what is better.

Every part leaves files in a work folder, from which an interrupted run goes on.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import torch

from mottrack.core.errors import ConfigError
from mottrack.core.storage import write_text
from mottrack.eval.label_free import MOVING, STATIC
from mottrack.experiment.experiment import Experiment
from mottrack.flow.pillarflow.decoders import PRESETS, preset
from mottrack.flow.pillarflow.source import PillarFlowConfig, weights_path
from mottrack.flow.pillarflow.training.checkpoint import Progress
from mottrack.flow.pillarflow.training.config import ScheduleConfig, TrainConfig
from mottrack.flow.pillarflow.training.shards import Shards
from mottrack.flow.pillarflow.training.trainer import RankInfo, Trainer
from mottrack.flow.pillarflow.training.validation import Scores, cell_errors
from mottrack.flow.pillarflow.weights_file import Weights, load_weights, save_weights
from mottrack.flow.shipped_errors import write_beside
from mottrack.runs.runner import scene_names
from mottrack.studies.adaptation.card import Outcome, card_text
from mottrack.studies.adaptation.config import AdaptConfig, Files
from mottrack.studies.adaptation.examples import (
    VALIDATION_SEED,
    WORLD_SEED,
    Mixed,
    label_logs,
    world_examples,
)
from mottrack.studies.adaptation.judgement import FIELDS, Judge, Verdict
from mottrack.studies.adaptation.stretches import split_logs

WARM_UP_STEPS = 10
"""The optimiser has no moments yet: full steps would leave the weights' neighbourhood."""
EMA_DECAY = 0.98
"""Averages the last fifty steps: a run is a hundredth as long as a training from random weights."""


class Watch(Protocol):
    """Receives the progress."""

    def part(self, title: str, done: int, total: int) -> None:
        """Receive how much of a part of the work is done."""
        ...

    def training(self, progress: Progress, steps: int) -> None:
        """Receive a training step."""
        ...


def adapt(experiment: Experiment, config: AdaptConfig, out: Path, watch: Watch) -> Outcome:
    """Tune the weights to the logs of an experiment; write them only if they are better there.

    Args:
        experiment: its data set's scenes are the logs, without labels; flow settings are used to
            judge.
        config: settings.
        out: file of the adapted weights; a work folder and a report lie beside it.
        watch: receives the progress.

    Raises:
        ConfigError: the logs have no sweeps or too few, or the work folder is of other settings.
        DataError: a file is damaged.
    """
    files = Files(out)
    start = load_weights(weights_path(config.weights))
    dataset = experiment.dataset.make()
    split = split_logs(dataset, scene_names(experiment), config.held_out_share)
    _reserve(files, experiment, config)
    covered = label_logs(
        dataset, split.training, files, config, lambda d, t: watch.part("label", d, t)
    )
    world = world_examples(
        files.synthetic, WORLD_SEED, config.synthetic_pairs, lambda d, t: watch.part("world", d, t)
    )
    validation = world_examples(
        files.validation,
        VALIDATION_SEED,
        config.validation_pairs,
        lambda d, t: watch.part("world, held out", d, t),
    )
    mixed = Mixed(Shards(files.examples), world, config.synthetic_share)
    trainer = _trainer(files, config, start)
    trainer.fit(mixed, validation, lambda progress: watch.training(progress, config.steps))
    before = cell_errors(start.network, validation, trainer.config.crop).scores(start.calibration)
    after = trainer.validate(validation).scores(start.calibration)
    candidate = files.training / "weights.safetensors"
    save_weights(candidate, replace(start, network=trainer.averaged().eval()))
    own = experiment.flow.config
    flow = own if isinstance(own, PillarFlowConfig) else PillarFlowConfig()
    judge = Judge(dataset, split.held_out, flow, experiment.settings)
    verdict = judge.compare(config.weights, candidate, lambda d, t: watch.part("judge", d, t))
    reason = why_not(verdict, before, after, config)
    outcome = Outcome(verdict, before, after, covered, split, reason)
    write_text(files.report, json.dumps(outcome.as_dict(), indent=1) + "\n")
    if outcome.kept:
        save_weights(files.out, load_weights(candidate))
        write_beside(files.out, config.weights)
        write_text(files.card, card_text(files, experiment, config, outcome))
    return outcome


def why_not(verdict: Verdict, before: Scores, after: Scores, config: AdaptConfig) -> str:
    """Return why adapted weights are not kept; nothing where they are."""
    alone, staged = (verdict.error(name) for name in FIELDS)
    if alone is None or staged is None:
        return "nothing moved or rested visibly on the held-out stretches"
    if alone.better is not True:
        return (
            f"the error of the network alone on {verdict.stretches} held-out stretches is "
            f"{alone.baseline:.3f} -> {alone.value:.3f} m/s, not significantly better"
        )
    if staged.better is False:
        return (
            f"with the stages after it the error on {verdict.stretches} held-out stretches is "
            f"{staged.baseline:.3f} -> {staged.value:.3f} m/s, significantly worse"
        )
    for name, rows in verdict.fields.items():
        worse = [row for row in rows if row.key in (MOVING, STATIC) and row.better is False]
        for row in worse:
            return (
                f"the {row.key.row} residual, {name}, on {verdict.stretches} held-out stretches is "
                f"{row.baseline:.3f} -> {row.value:.3f} m/s, significantly worse"
            )
    limit = (1.0 + config.most_forgotten) * before.dynamic_rmse
    if after.dynamic_rmse > limit:
        return (
            f"the dynamic RMSE on the embedded world is {before.dynamic_rmse:.3f} -> "
            f"{after.dynamic_rmse:.3f} m/s, above the limit of {limit:.3f}: it forgets"
        )
    return ""


def _reserve(files: Files, experiment: Experiment, config: AdaptConfig) -> None:
    """Note what the work folder is made with, or check it; steps alone may change."""
    same = config.model_dump(mode="json", exclude={"steps", "save_every"})
    noted = json.dumps({"adapt": same, "dataset": experiment.dataset.resolved()}, default=str)
    if files.settings.exists() and files.settings.read_text(encoding="utf-8") != noted:
        raise ConfigError(
            f"{files.work} holds an adaptation of other logs or settings; remove the folder or "
            "choose another --out"
        )
    write_text(files.settings, noted)


def _trainer(files: Files, config: AdaptConfig, start: Weights) -> Trainer:
    """Make a trainer that begins with the start weights, or with the checkpoint."""
    name = next((p for p in PRESETS if preset(p) == start.network.config), None)
    if name is None:
        expected = f"those of one of the networks {', '.join(PRESETS)}"
        raise ConfigError(f"adapt.weights is '{config.weights}', expected {expected}")
    schedule = ScheduleConfig(warm_up_steps=min(WARM_UP_STEPS, config.steps))
    settings = TrainConfig(
        network=name,
        initial=config.weights,
        learning_rate=config.learning_rate,
        schedule=schedule,
        steps=config.steps,
        batch_size=config.batch_size,
        ema_decay=EMA_DECAY,
        seed=config.seed,
        validate_every=config.steps + 1,
        save_every=config.save_every,
        log_every=5,
        threads=torch.get_num_threads(),
    )
    files.training.mkdir(parents=True, exist_ok=True)
    return Trainer(settings, RankInfo(0, 1, torch.device("cpu")), files.training)

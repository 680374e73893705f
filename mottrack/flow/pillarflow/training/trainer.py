"""Training on one process or on those of `torchrun`: the loop, and a whole run around it."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from pydantic import ValidationError
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from mottrack.core.errors import ConfigError
from mottrack.flow.pillarflow.calibration import fit_calibration
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoders import preset
from mottrack.flow.pillarflow.engine import use_threads
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.source import weights_path
from mottrack.flow.pillarflow.training.batches import Batch, Sampler, stream
from mottrack.flow.pillarflow.training.checkpoint import Progress, TrainingState, WeightAverage
from mottrack.flow.pillarflow.training.config import TrainConfig
from mottrack.flow.pillarflow.training.examples import Example
from mottrack.flow.pillarflow.training.losses import multi_scale_loss
from mottrack.flow.pillarflow.training.validation import CellErrors, Scores, cell_errors
from mottrack.flow.pillarflow.weights_file import (
    Weights,
    first_problem,
    load_weights,
    save_weights,
    widen,
)

Report = Callable[[Progress], None]


@dataclass(frozen=True)
class RankInfo:
    """This process among those of the run."""

    rank: int
    """The process of rank 0 writes the files."""
    world_size: int
    """Number of processes."""
    device: torch.device
    """Device of its network."""

    @property
    def is_first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    @classmethod
    def join(cls) -> RankInfo:
        """Join the process group that `torchrun` describes in the environment, if it does."""
        rank, world_size = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
        cuda = torch.cuda.is_available()
        device = torch.device("cpu")
        if cuda:
            device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
            torch.cuda.set_device(device)
        if world_size > 1 and not distributed.is_initialized():
            distributed.init_process_group("nccl" if cuda else "gloo")
        return cls(rank, world_size, device)

    def leave(self) -> None:
        """Close the process group."""
        if self.world_size > 1 and distributed.is_initialized():
            distributed.destroy_process_group()


class Trainer:
    """One run: `fit` takes it from its last checkpoint to `config.steps`."""

    def __init__(self, config: TrainConfig, rank: RankInfo, out: Path) -> None:
        """Build the network from the seed; resume if `out` holds a checkpoint."""
        self.config, self.rank, self.out = config, rank, out
        use_threads(config.threads)
        torch.manual_seed(config.seed)
        self.network = channels_last(initial_network(config).to(rank.device))
        self.average = WeightAverage(self.network, config.ema_decay)
        self.optimiser = _optimiser(config, self.network)
        self.progress = Progress()
        self._state = TrainingState(self.network, self.average, self.optimiser, self.progress)
        self._file = out / "checkpoint.safetensors"
        if self._file.exists():
            self._state.load(self._file)

    def fit(
        self, examples: Sequence[Example], held_out: Sequence[Example], report: Report
    ) -> Progress:
        """Train to the last step; validate, save and report on the way.

        Raises:
            ConfigError: the loss is not finite.
        """
        config = self.config
        sampler = Sampler(
            examples, self.network.config.cell_m, config.crop, config.augmentation, config.seed
        )
        model = self._replicated()
        steps = range(self.progress.step, config.steps)
        batches = stream(
            sampler,
            steps,
            config.batch_size,
            first=self.rank.rank * config.batch_size,
            workers=config.loader_threads,
        )
        losses: list[float] = []
        started, before = time.monotonic(), self.progress.seconds
        for step, batch in zip(steps, batches, strict=True):
            losses.append(self._step(model, batch.to(self.rank.device), step))
            self.progress.step = step + 1
            self.progress.seconds = before + time.monotonic() - started
            self._milestones(losses, held_out, report)
        return self.progress

    def validate(self, held_out: Sequence[Example]) -> CellErrors:
        """Return the errors of the averaged weights."""
        return cell_errors(self.averaged(), held_out, self.config.crop)

    def averaged(self) -> PillarFlowNet:
        """Return a network with the averaged weights."""
        network = PillarFlowNet(self.network.config).to(self.rank.device)
        network.load_state_dict(self.average.state)
        return channels_last(network)

    def save(self) -> None:
        """Write the checkpoint (first process only)."""
        if self.rank.is_first:
            self._state.save(self._file)

    def _replicated(self) -> nn.Module:
        if self.rank.world_size == 1:
            return self.network
        device = self.rank.device
        devices = [device.index] if device.type == "cuda" else None
        replicated: nn.Module = DistributedDataParallel(self.network, device_ids=devices)
        return replicated

    def _step(self, model: nn.Module, batch: Batch, step: int) -> float:
        config = self.config
        for group in self.optimiser.param_groups:
            group["lr"] = config.learning_rate * config.schedule.factor(step, config.steps)
        half = config.precision == "bf16"
        with torch.autocast(self.rank.device.type, torch.bfloat16, enabled=half):
            estimate = model(batch.pair)
        loss = multi_scale_loss(estimate, batch.target, config.loss)
        _require_finite(float(loss.detach()), step, config)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), config.max_gradient_norm)
        self.optimiser.step()
        self.average.update(self.network, step)
        return float(loss.detach())

    def _milestones(self, losses: list[float], held_out: Sequence[Example], report: Report) -> None:
        step, config, history = self.progress.step, self.config, self.progress.history
        last = step == config.steps
        if step % config.log_every == 0 or last:
            history.append({"step": float(step), "loss": sum(losses) / max(len(losses), 1)})
            losses.clear()
        if self.rank.is_first and step % config.validate_every == 0 and not last:
            scores = self.validate(held_out).scores()
            history.append({"step": float(step), **asdict(scores)})
        if step % config.save_every == 0 or last:
            self.save()
        report(self.progress)


def _require_finite(loss: float, step: int, config: TrainConfig) -> None:
    if not math.isfinite(loss):
        raise ConfigError(
            f"loss is {loss} at step {step} with learning_rate {config.learning_rate:g}, precision "
            f"{config.precision}, expected a finite number: lower the rate; bf16 needs a CPU with "
            "correct bfloat16 convolutions, else precision=fp32"
        )


def network_config(config: TrainConfig) -> NetworkConfig:
    """Return the network that a run trains.

    Raises:
        ConfigError: `network_settings` has an unknown key or an unusable value.
        InputError: there is no preset of that name.
    """
    chosen = preset(config.network).model_dump() | config.network_settings
    try:
        return NetworkConfig.model_validate(chosen)
    except ValidationError as error:
        raise ConfigError(
            f"network_settings: {first_problem(error)}, expected settings of a network"
        ) from error


def initial_network(config: TrainConfig) -> PillarFlowNet:
    """Return the network of a run before its first step: random, or begun from other weights.

    Raises:
        DataError: the initial weights are absent, unusable or of another network.
        ConfigError: as `network_config`.
    """
    network = PillarFlowNet(network_config(config))
    if config.initial is not None:
        file = weights_path(config.initial)
        widen(file, load_weights(file).network, network)
    return network


def _optimiser(config: TrainConfig, network: nn.Module) -> torch.optim.Optimizer:
    kind = torch.optim.AdamW if config.optimiser == "adamw" else torch.optim.Adam
    return kind(
        network.parameters(),
        lr=config.learning_rate,
        weight_decay=config.weight_decay,
        fused=True,
    )


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
        (out / "config.json").write_text(config.model_dump_json(indent=1) + "\n", encoding="utf-8")
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
    progress.history.append({"step": float(progress.step), **asdict(scores)})
    trainer.save()
    summary = {"step": progress.step, "seconds": progress.seconds, **asdict(scores)}
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
    left.set(xlabel="step", ylabel="training loss")  # it may be negative: no logarithm
    checks = [point for point in history if "dynamic_rmse" in point]
    for name in ("dynamic_rmse", "dynamic_median", "static_rmse"):
        right.plot([p["step"] for p in checks], [p[name] for p in checks], ".-", label=name)
    right.set(xlabel="step", ylabel="held-out error [m/s]", yscale="log")
    right.legend()
    figure.savefig(out / "curve.png", dpi=120)

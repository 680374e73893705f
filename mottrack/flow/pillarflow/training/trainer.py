"""The training loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel

from mottrack.flow.pillarflow.descriptors import CellGrid
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.presets import preset
from mottrack.flow.pillarflow.threads import use_threads
from mottrack.flow.pillarflow.training.average import WeightAverage
from mottrack.flow.pillarflow.training.batches import Batch, Sampler, stream
from mottrack.flow.pillarflow.training.checkpoint import (
    Progress,
    load_checkpoint,
    save_checkpoint,
)
from mottrack.flow.pillarflow.training.config import TrainConfig
from mottrack.flow.pillarflow.training.example import EXAMPLE_GRID, Example
from mottrack.flow.pillarflow.training.losses import multi_scale_loss
from mottrack.flow.pillarflow.training.parallel import Place
from mottrack.flow.pillarflow.training.schedule import rate
from mottrack.flow.pillarflow.training.validation import CellErrors, cell_errors

PRECISION = {"fp32": None, "bf16": torch.bfloat16, "fp16": torch.float16}
Report = Callable[[Progress], None]


class Trainer:
    """One run: `fit` takes it from where it stands to `config.steps`."""

    def __init__(self, config: TrainConfig, place: Place, out: Path) -> None:
        """Build the network from the seed; resume if `out` holds a checkpoint."""
        self.config, self.place, self.file = config, place, out / "checkpoint.safetensors"
        use_threads(config.threads)
        torch.manual_seed(config.seed)
        network = PillarFlowNet(preset(config.network)).to(place.device)
        self.network = channels_last(network)
        self.average = WeightAverage(self.network, config.ema)
        self.optimiser = _optimiser(config, self.network)
        self.scaler = torch.amp.GradScaler(place.device.type, enabled=config.precision == "fp16")
        self.progress = Progress(0, 0.0, [])
        if self.file.exists():
            self.progress = load_checkpoint(self.file, self.network, self.average, self.optimiser)

    def fit(
        self, examples: Sequence[Example], held_out: Sequence[Example], report: Report
    ) -> Progress:
        """Train to the last step, validating and saving on the way."""
        config = self.config
        sampler = Sampler(
            examples, self.network.config.cell_m, config.crop, config.augmentation, config.seed
        )
        model = self._replicated()
        steps = range(self.progress.step, config.steps)
        batches = stream(
            sampler,
            steps,
            config.batch,
            first=self.place.rank * config.batch,
            workers=config.loader_threads,
        )
        losses: list[float] = []
        started, before = time.monotonic(), self.progress.seconds
        for step, batch in zip(steps, batches, strict=True):
            losses.append(self._step(model, batch.to(self.place.device), step))
            self.progress.step = step + 1
            self.progress.seconds = before + time.monotonic() - started
            self._milestones(losses, held_out, report)
        return self.progress

    def validate(self, held_out: Sequence[Example]) -> CellErrors:
        """Errors of the averaged weights."""
        network = self.averaged()
        side = round(2 * EXAMPLE_GRID.x_max_m / network.config.cell_m)
        side = -(-side // network.config.multiple) * network.config.multiple
        corner = EXAMPLE_GRID.x_min_m
        cells = CellGrid(corner, corner, network.config.cell_m, side, side)
        return cell_errors(network, held_out, cells, self.config.crop)

    def averaged(self) -> PillarFlowNet:
        """A network with the averaged weights."""
        network = PillarFlowNet(self.network.config).to(self.place.device)
        network.load_state_dict(self.average.state)
        return channels_last(network)

    def save(self) -> None:
        """Write the checkpoint (first process only)."""
        if self.place.first:
            save_checkpoint(self.file, self.network, self.average, self.optimiser, self.progress)

    def _replicated(self) -> nn.Module:
        if self.place.size == 1:
            return self.network
        devices = [self.place.device.index] if self.place.device.type == "cuda" else None
        replicated: nn.Module = DistributedDataParallel(self.network, device_ids=devices)
        return replicated

    def _step(self, model: nn.Module, batch: Batch, step: int) -> float:
        config = self.config
        for group in self.optimiser.param_groups:
            group["lr"] = config.learning_rate * rate(config.schedule, step, config.steps)
        kind = PRECISION[config.precision]
        with torch.autocast(self.place.device.type, dtype=kind, enabled=kind is not None):
            estimate = model(batch.pair)
        loss = multi_scale_loss(estimate, batch.target, config.loss)
        self.optimiser.zero_grad(set_to_none=True)
        self.scaler.scale(loss).backward()  # type: ignore[no-untyped-call]
        self.scaler.unscale_(self.optimiser)
        nn.utils.clip_grad_norm_(self.network.parameters(), config.clip)
        self.scaler.step(self.optimiser)
        self.scaler.update()
        self.average.update(self.network, step)
        return float(loss.detach())

    def _milestones(self, losses: list[float], held_out: Sequence[Example], report: Report) -> None:
        step, config = self.progress.step, self.config
        last = step == config.steps
        if step % config.log_every == 0 or last:
            point = {"step": float(step), "loss": sum(losses) / max(len(losses), 1)}
            self.progress.history.append(point)
            losses.clear()
        if self.place.first and step % config.validate_every == 0 and not last:
            scores = self.validate(held_out).scores()
            self.progress.history.append({"step": float(step), **scores.as_dict()})
        if step % config.save_every == 0 or last:
            self.save()
        report(self.progress)


def _optimiser(config: TrainConfig, network: nn.Module) -> torch.optim.Optimizer:
    kind = torch.optim.AdamW if config.optimiser == "adamw" else torch.optim.Adam
    return kind(
        network.parameters(),
        lr=config.learning_rate,
        weight_decay=config.weight_decay,
        fused=True,
    )

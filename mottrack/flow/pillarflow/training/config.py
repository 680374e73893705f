"""Configuration of a training run."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import Field

from mottrack.config import StrictModel


class AugmentationConfig(StrictModel):
    """Changes made to training examples."""

    rotate: bool = Field(True, description="rotate the world about the vehicle, flip it")
    box_scale: float = Field(0.15, ge=0, lt=1, description="objects grow or shrink by up to this")
    thinned_share: float = Field(0.2, ge=0, le=1, description="share of examples that lose points")
    min_kept_share: float = Field(0.3, gt=0, le=1, description="smallest share of points kept then")
    pose_noise_m: float = Field(0.015, ge=0, description="standard deviation of residual odometry")
    pose_noise_rad: float = Field(0.0006, ge=0, description="the same of the heading")
    height_noise_m: float = Field(0.05, ge=0, description="offset of the ground, of both sweeps")
    no_visibility_share: float = Field(
        0.1, ge=0, le=1, description="share of examples without visibility"
    )
    no_older_share: float = Field(
        0.2, ge=0, le=1, description="share of examples that lose all older sweeps, or the oldest"
    )
    no_reflectance_share: float = Field(
        0.3, ge=0, le=1, description="share of examples without reflectance"
    )
    gamma: float = Field(0.7, ge=0, description="reflectance ** exp(u), |u| up to this")


class CropConfig(StrictModel):
    """Size, place and labels of the crops."""

    size_m: float = Field(32.0, gt=0, description="edge of the square [m]")
    moving_share: float = Field(0.6, ge=0, le=1, description="share of crops at a moving object")
    jitter_m: float = Field(8.0, ge=0, description="the square is off its point by up to this")
    moving_mps: float = Field(0.5, gt=0, description="a point this fast is moving")
    min_previous_points: int = Field(
        5, ge=0, description="objects with fewer points in the previous sweep are masked"
    )
    min_current_points: int = Field(
        3, ge=0, description="objects with fewer points in the current sweep are masked"
    )


class LossConfig(StrictModel):
    """Which loss, and its weights."""

    kind: Literal["balanced", "paper"] = Field(
        "balanced", description="balanced: means over buckets of speed; paper: sum over all cells"
    )
    level_decay: float = Field(0.5, gt=0, le=1, description="weight of a level / next finer one")
    speed_edges_mps: tuple[float, ...] = Field((0.5, 3.0, 8.0), description="edges of the buckets")
    static_weight: float = Field(1.5, gt=0, description="weight of the slowest bucket")
    shadow_weight: float = Field(
        0.0, ge=0, description="further weight of its cells at shadow edges, which look like motion"
    )
    empty_weight: float = Field(
        0.1,
        ge=0,
        description="weight of the displacements of empty cells; without it they grow without"
        " bound and dominate the statistics of the batch normalisation",
    )
    nll_weight: float = Field(0.1, ge=0, description="weight of the uncertainty head's loss")


class ExamplesConfig(StrictModel):
    """Source of the examples; they are made once, before training, and kept as shards."""

    dataset: dict[str, Any] | None = Field(
        None, description="a recorded data set with tracks (kind and settings); null: the world"
    )
    world: dict[str, Any] = Field(
        default_factory=dict, description="settings of the embedded world's training pairs"
    )
    pair_s: float = Field(0.1, gt=0, description="wanted age of a recorded pair's earlier sweep")
    older_ages_s: tuple[float, ...] = Field(
        (), description="wanted ages of a recorded pair's older sweeps, from the youngest on"
    )
    seed: int = Field(1, ge=0, description="seed of the embedded world")
    pairs: int = Field(6000, ge=1, description="number of examples")
    validation_seed: int = Field(900_001, ge=0, description="seed of the held-out pairs")
    validation_pairs: int = Field(50, ge=1, description="number of held-out examples")
    remove_ground: bool = Field(
        True, description="remove the ground's points (false: the ablation of Table II)"
    )
    per_shard: int = Field(50, ge=1, description="examples in a shard")


class ScheduleConfig(StrictModel):
    """Learning rate from the first to the last step."""

    kind: Literal["cosine", "trapezoid", "exponential"] = Field(
        "trapezoid",
        description="trapezoid: flat, then linear to zero; exponential: the paper's 0.9 a tenth",
    )
    warm_up_steps: int = Field(50, ge=0, description="linear rise from zero")
    decay_share: float = Field(0.3, gt=0, le=1, description="falling part of a trapezoid")

    def factor(self, step: int, steps: int) -> float:
        """Return the share of the full learning rate at `step` of `steps`."""
        if step < self.warm_up_steps:
            return (step + 1) / self.warm_up_steps
        progress = min(step / max(steps, 1), 1.0)
        if self.kind == "exponential":
            return float(0.9 ** math.floor(10 * progress))
        if self.kind == "cosine":
            return 0.5 * (1.0 + math.cos(math.pi * progress))
        return min(1.0, (1.0 - progress) / self.decay_share)


class TrainConfig(StrictModel):
    """One training run."""

    network: str = Field("base", description="name of a preset")
    network_settings: dict[str, Any] = Field(
        default_factory=dict, description="settings of the network that differ from the preset"
    )
    initial: str | None = Field(
        None,
        description="weights to begin with, shipped ones by name or a file, of the same network or"
        " of one with fewer inputs; null: random ones",
    )
    examples: ExamplesConfig = Field(default_factory=ExamplesConfig)
    crop: CropConfig = Field(default_factory=CropConfig)
    augmentation: AugmentationConfig = Field(default_factory=AugmentationConfig)
    loss: LossConfig = Field(default_factory=LossConfig)
    optimiser: Literal["adamw", "adam"] = Field("adamw", description="adam is the paper's")
    learning_rate: float = Field(3e-3, gt=0, description="largest learning rate")
    weight_decay: float = Field(1e-4, ge=0, description="decoupled (adamw) or not (adam)")
    max_gradient_norm: float = Field(1.0, gt=0, description="a longer gradient is shortened to it")
    schedule: ScheduleConfig = Field(default_factory=ScheduleConfig)
    steps: int = Field(10_000, ge=1, description="length of the run; may grow on resume")
    batch_size: int = Field(8, ge=1, description="crops of a step and process")
    ema_decay: float = Field(0.998, ge=0, lt=1, description="decay of the averaged weights")
    seed: int = Field(0, ge=0, description="of the weights and the stream of crops")
    precision: Literal["fp32", "bf16"] = Field("fp32", description="of the convolutions")
    threads: int = Field(0, ge=0, description="CPU threads; 0: torch's choice")
    loader_threads: int = Field(1, ge=1, description="threads that make batches ahead")
    log_every: int = Field(25, ge=1, description="steps to a point of the loss curve")
    validate_every: int = Field(1000, ge=1, description="steps to a validation")
    save_every: int = Field(500, ge=1, description="steps to a checkpoint")

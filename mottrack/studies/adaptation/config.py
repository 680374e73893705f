"""Settings of an adaptation, and where it keeps its files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.cluster_icp import ClusterIcpConfig


class AdaptConfig(StrictModel):
    """How the network is tuned; the keys are set as `adapt.KEY=VALUE`."""

    weights: str = Field("base", description="weights to begin with, by name or a file")
    teacher: ClusterIcpConfig = Field(
        default_factory=ClusterIcpConfig, description="registration that makes the labels"
    )
    frames: int = Field(80, ge=2, description="frames of the logs that get labels, at most")
    held_out_share: float = Field(
        0.3, gt=0, lt=1, description="share of the logs' stretches that judges the result"
    )
    synthetic_share: float = Field(
        0.5, ge=0, lt=1, description="share of the crops from the embedded world: no forgetting"
    )
    synthetic_pairs: int = Field(60, ge=1, description="pairs of the embedded world to train on")
    validation_pairs: int = Field(
        16, ge=2, description="other pairs of it that show whether the network forgets"
    )
    most_forgotten: float = Field(
        0.05, ge=0, description="largest growth of their dynamic RMSE that is accepted, as a share"
    )
    steps: int = Field(
        150, ge=1, description="training steps; may grow when the command is resumed"
    )
    batch_size: int = Field(8, ge=1, description="crops of a step")
    learning_rate: float = Field(5e-4, gt=0, description="largest learning rate")
    seed: int = Field(0, ge=0, description="of the choice of frames and the stream of crops")
    save_every: int = Field(25, ge=1, description="steps to a checkpoint")


@dataclass(frozen=True)
class Files:
    """What an adaptation reads and writes."""

    out: Path
    """The adapted weights; nothing is there where the shipped ones stay."""

    @property
    def work(self) -> Path:
        """Folder of examples and checkpoint: an interrupted command goes on from it."""
        return self.out.with_suffix(".work")

    @property
    def settings(self) -> Path:
        """What the work folder was made with."""
        return self.work / "adapt.json"

    @property
    def examples(self) -> Path:
        """Shards of the logs' examples."""
        return self.work / "logs"

    @property
    def synthetic(self) -> Path:
        """Shards of the embedded world's."""
        return self.work / "world"

    @property
    def validation(self) -> Path:
        """Shards of the world's pairs that are not trained on."""
        return self.work / "validation"

    @property
    def training(self) -> Path:
        """Folder of the training run."""
        return self.work / "training"

    @property
    def card(self) -> Path:
        """What the weights are, for a reader."""
        return self.out.with_suffix(".md")

    @property
    def report(self) -> Path:
        """The figures before and after; written whether the weights are kept or not."""
        return self.out.with_suffix(".json")

"""Settings of an experiment beside those of its four parts."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.grid import BevGrid
from mottrack.eval.scores import ScoreConfig
from mottrack.experiment.criteria import Criterion
from mottrack.objects.velocity import VelocityConfig

LabelFree = Literal["auto", "always", "never"]
MOST_CELLS = 4096
"""Of a side of the grid: 1 km at 0.25 m. More is a wrong unit, and would exhaust the memory."""


class GridConfig(StrictModel):
    """Extent and cell size of the bird's-eye-view grid; the default is the paper's."""

    x_min_m: float = Field(default=-50.0, description="rear edge")
    x_max_m: float = Field(default=50.0, description="front edge")
    y_min_m: float = Field(default=-50.0, description="right edge")
    y_max_m: float = Field(default=50.0, description="left edge")
    cell_m: float = Field(default=0.25, gt=0, description="side of a cell")

    @model_validator(mode="after")
    def _is_a_grid(self) -> Self:
        if max(self.grid().shape) > MOST_CELLS:
            raise ValueError(f"at most {MOST_CELLS} cells a side")
        return self

    def grid(self) -> BevGrid:
        """Return the grid."""
        return BevGrid(**self.model_dump())


class SnapshotConfig(StrictModel):
    """Key frames that are stored for the report, viewers and animations."""

    scenes: int = Field(
        default=6,
        ge=0,
        description="number of scenes, from the first on, whose key frames are stored",
    )
    points: int = Field(default=4000, ge=0, description="points of a sweep that are stored")


class Settings(StrictModel):
    """Settings of an experiment beside those of its four parts."""

    name: str = Field(default="", description="title in tables and reports")
    scenes: tuple[str, ...] | None = Field(
        default=None, min_length=1, description="names of scenes; null: all"
    )
    grid: GridConfig = GridConfig()
    velocity: VelocityConfig = VelocityConfig()
    scores: ScoreConfig = ScoreConfig()
    pair_s: float = Field(
        default=0.1,
        gt=0,
        le=0.5,
        description="desired time between the two sweeps of a flow",
    )
    max_pair_s: float = Field(
        default=0.3,
        gt=0,
        le=0.5,
        description="longest time between them: objects move too far",
    )
    history_s: float = Field(
        default=0.5,
        gt=0,
        le=1.0,
        description="age of the oldest sweep that a flow source with several past sweeps gets",
    )
    score_flow: bool = Field(default=True, description="compare the flow with truth, cell by cell")
    label_free: LabelFree = Field(
        default="auto",
        description="judge the flow by geometry, without labels; auto: key frames without truth",
    )
    flow_sample_limit: int = Field(
        default=4000, ge=1, description="cells per frame that are sampled for the flow scores"
    )
    snapshots: SnapshotConfig = SnapshotConfig()
    criteria: tuple[Criterion, ...] = Field(
        default=(), description="claims about the runs, judged after them"
    )

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if self.pair_s > self.max_pair_s:
            raise ValueError(f"pair_s at most max_pair_s, {self.max_pair_s}")
        if self.scenes is not None and len(set(self.scenes)) != len(self.scenes):
            raise ValueError("each of scenes once")
        return self

"""Settings of the embedded world as a data set."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mottrack.config import StrictModel
from mottrack.world.config import DensityConfig, DetectorConfig, PoseErrorConfig


class SyntheticConfig(StrictModel):
    """The embedded world.

    Scene k of a seed is the same whatever the number of scenes, of workers, and the order.
    """

    scenes: int = Field(10, ge=1, le=100_000, description="number of scenes")
    seed: int = Field(0, ge=0, lt=2**31, description="seed of all random draws")
    first_scene: int = Field(0, ge=0, le=1_000_000, description="number of the first scene")
    duration_s: float = Field(20.0, ge=0.2, le=120.0, description="length of each scene")
    place: Literal["random", "urban", "residential", "motorway"] = Field(
        "random", description="kind of road"
    )
    sensor: str = Field("uniform32", description="LiDAR model, or 'random' for one per scene")
    sweep_hz: int = Field(10, ge=1, le=20, description="revolutions of the LiDAR per second")
    key_hz: int = Field(2, ge=1, le=20, description="key frames per second; divides sweep_hz")
    rolling: bool = Field(True, description="columns fire one after the other")
    truth_range_m: float = Field(
        75.0, gt=0.0, le=200.0, description="objects further from the vehicle are not in the truth"
    )
    density: DensityConfig = DensityConfig()
    pose_error: PoseErrorConfig = PoseErrorConfig()
    detector: DetectorConfig = DetectorConfig()

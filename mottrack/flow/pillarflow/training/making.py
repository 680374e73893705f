"""Examples made ahead: pairs of sweeps prepared as at inference, written as shards."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mottrack.core.grid import BevGrid
from mottrack.core.sweep import Sweep
from mottrack.flow.pillarflow.training.example import Example, Labels, example_of, numbered
from mottrack.flow.pillarflow.training.shards import write_shard
from mottrack.flow.stages import Stages, StagesConfig
from mottrack.flow.sweep_pair import GroundStage

EDGE_M = 50.5


@dataclass(frozen=True)
class LabelledPair:
    """Two sweeps, each in its own ego frame, and their truth."""

    previous: Sweep
    """The earlier one."""
    current: Sweep
    """The later one."""
    labels: Labels
    """Truth of every point of both."""


class ExampleMaker:
    """Prepares pairs with the stages of inference."""

    def __init__(self, *, ground: bool) -> None:
        """`ground` off keeps the ground's points (the ablation of Table II)."""
        self.grid = BevGrid()
        stages = StagesConfig(ground=GroundStage(enabled=ground))
        self.stages = Stages(stages, self.grid)

    def make(self, pair: LabelledPair) -> Example:
        """One example, cut to the grid."""
        prepared = self.stages.before(numbered(pair.previous), numbered(pair.current))
        return within(example_of(prepared, pair.labels, self.grid), EDGE_M)

    def write(self, pairs: Iterable[LabelledPair], file: Path) -> None:
        """One shard."""
        write_shard(file, [self.make(pair) for pair in pairs])


def within(example: Example, edge_m: float) -> Example:
    """The points inside a square around the vehicle."""
    then = np.abs(example.previous[:, :2]).max(axis=1, initial=0.0) < edge_m
    now = np.abs(example.current[:, :2]).max(axis=1, initial=0.0) < edge_m
    return replace(
        example,
        previous=example.previous[then],
        previous_object=example.previous_object[then],
        current=example.current[now],
        current_object=example.current_object[now],
        motion_m=example.motion_m[now],
    )

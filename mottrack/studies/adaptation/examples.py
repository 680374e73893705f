"""Examples of an adaptation: those of the logs, made stretch by stretch, and of the world."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import overload

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Dataset, Scene
from mottrack.core.storage import write_text
from mottrack.flow.cluster_icp import ClusterIcpFlow
from mottrack.flow.pillarflow.training.examples import Example, ExampleBuilder
from mottrack.flow.pillarflow.training.shards import Shards, write_shard
from mottrack.studies.adaptation.config import AdaptConfig, Files
from mottrack.studies.adaptation.pseudo_labels import (
    LABEL_GRID,
    Coverage,
    LabelledFrame,
    label_frame,
)
from mottrack.studies.adaptation.stretches import Stretch
from mottrack.studies.training_examples import world_pair

OnPart = Callable[[int, int], None]
WORLD_SEED, VALIDATION_SEED = 940_001, 950_001
"""Seeds of the world that no training, calibration or table uses."""
PER_SHARD = 10
"""Examples of the world in a file: so many are lost at most by an interruption."""
WAYS = 100
"""Places of each example of the logs in a mixture; the world takes its share, to 1 %."""
SEEN = 2
"""Baselines of the pairs, in turn: the network is used over 0.1 s and 0.2 s."""
LEAST_MOVING = 50
"""Cells with a moving label over all frames: with fewer the logs teach nothing about motion."""


@dataclass(frozen=True)
class Mixed(Sequence[Example]):
    """Examples of the logs and of the world, in the wanted shares: a sequence to draw from."""

    logs: Sequence[Example]
    world: Sequence[Example]
    synthetic_share: float

    def __len__(self) -> int:
        return len(self.logs) * WAYS

    @overload
    def __getitem__(self, index: int) -> Example: ...

    @overload
    def __getitem__(self, index: slice) -> list[Example]: ...

    def __getitem__(self, index: int | slice) -> Example | list[Example]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        log, way = divmod(index, WAYS)
        if way < self.synthetic_share * WAYS:
            return self.world[(log * WAYS + way) % len(self.world)]
        return self.logs[log]


def chosen_frames(stretches: Sequence[Stretch], config: AdaptConfig) -> list[Stretch]:
    """Return the training stretches with every n-th frame, so that there are not too many."""
    total = sum(len(s.frames) for s in stretches)
    step = max(-(-total // config.frames), 1)
    return [Stretch(s.scene, s.frames[::step]) for s in stretches]


def label_logs(
    dataset: Dataset, stretches: Sequence[Stretch], files: Files, config: AdaptConfig, on: OnPart
) -> Coverage:
    """Make the missing examples of the logs, a file for each stretch; return what was labelled.

    Raises:
        ConfigError: hardly any moving object was found.
    """
    files.examples.mkdir(parents=True, exist_ok=True)
    teacher = ClusterIcpFlow(config.teacher, grid=LABEL_GRID)
    builder, covered = ExampleBuilder(remove_ground=True), Coverage()
    for k, stretch in enumerate(chosen_frames(stretches, config)):
        noted = files.examples / f"{stretch.name}.json"
        if not noted.exists():
            found = list(_labelled(dataset.scene(stretch.scene), stretch, teacher))
            part = sum((frame.coverage for frame in found), Coverage())
            if found:
                shard = files.examples / f"{stretch.name}.safetensors"
                write_shard(shard, [builder.build(frame.pair) for frame in found])
            write_text(noted, json.dumps(asdict(part)))
        covered += Coverage(**json.loads(noted.read_text(encoding="utf-8")))
        on(k + 1, len(stretches))
    if covered.moving < LEAST_MOVING:
        raise ConfigError(
            f"registration labels {covered.moving} moving cells in the logs, expected at least "
            f"{LEAST_MOVING}: they hold too little traffic to learn from"
        )
    return covered


def _labelled(scene: Scene, stretch: Stretch, teacher: ClusterIcpFlow) -> Iterator[LabelledFrame]:
    for k, index in enumerate(stretch.frames):
        found = label_frame(scene, index, teacher, seen=k % SEEN)
        if found is not None and found.coverage.moving + found.coverage.static:
            yield found


def world_examples(folder: Path, seed: int, count: int, on: OnPart) -> Shards:
    """Make the missing pairs of the embedded world in a folder; open all."""
    folder.mkdir(parents=True, exist_ok=True)
    builder = ExampleBuilder(remove_ground=True)
    for first in range(0, count, PER_SHARD):
        file = folder / f"{first:07d}.safetensors"
        last = min(first + PER_SHARD, count)
        if not file.exists():
            write_shard(file, [builder.build(world_pair(seed, i, {})) for i in range(first, last)])
        on(last, count)
    return Shards(folder)

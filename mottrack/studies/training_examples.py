"""Make training examples for PillarFlow from the embedded world or a data set with tracks."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mottrack.core.arrays import F32, I16, I64
from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Scene
from mottrack.core.objects import Truth
from mottrack.core.sweep import seconds_between
from mottrack.experiment.plugins import load_part
from mottrack.experiment.validation_message import format_validation_error
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.flow.pillarflow.training.examples import (
    ExampleBuilder,
    LabelledPair,
    Labels,
    labels_from_tracks,
)
from mottrack.flow.pillarflow.training.shards import write_shard
from mottrack.runs.tasks import OnStep, Outcome, Task
from mottrack.world import TrainingConfig, TrainingPair, training_pair

HELD_OUT_EVERY = 5
"""Every fifth recorded scene is held out: the usual 80 to 20 split."""
MAX_FRAMES_BACK = 10
"""The earlier sweep of a recorded pair is at most so many frames older: a second at 10 Hz."""


@dataclass(frozen=True)
class ShardTask(Task):
    """One shard of a set of examples."""

    folder: Path
    """Of the set."""
    config: ExamplesConfig
    split: str
    """`training` or `validation`."""
    first: int
    """Index of the first example."""
    count: int
    """Number of examples."""
    shards: int
    """Number of shards of the split."""

    @property
    def folders(self) -> tuple[Path, ...]:
        """The folder of the set."""
        return (self.folder,)

    @property
    def file(self) -> Path:
        """Where the shard goes."""
        return self._file(self.folder)

    def work(self, on_step: OnStep) -> list[Outcome]:
        """Make the examples and write the shard."""
        pairs = _world_pairs(self) if self.config.dataset is None else _recorded_pairs(self)
        builder = ExampleBuilder(remove_ground=self.config.remove_ground)
        examples = []
        for pair in pairs:
            examples.append(builder.build(pair))
            on_step(len(examples), self.count)
        write_shard(self.file, examples)
        return [Outcome(self.name, folder=self.folder)]

    def stored_in(self, folders: Sequence[Path]) -> ShardTask:
        """Return the same shard for another folder."""
        (folder,) = folders
        return replace(self, folder=folder)

    def files(self, folder: Path) -> dict[str, bytes]:
        """Read the shard."""
        file = self._file(folder)
        return {str(file.relative_to(folder)): file.read_bytes()}

    def _file(self, folder: Path) -> Path:
        return folder / f"{self.name}.safetensors"


def _world_pairs(job: ShardTask) -> Iterator[LabelledPair]:
    seed = job.config.seed if job.split == "training" else job.config.validation_seed
    for index in range(job.first, job.first + job.count):
        yield world_pair(seed, index, job.config.world)


def world_pair(seed: int, index: int, settings: dict[str, Any]) -> LabelledPair:
    """Return pair `index` of a seed of the embedded world.

    Args:
        seed: seed of the whole stream of pairs.
        index: of the pair within it.
        settings: those of `TrainingConfig`; the others have their defaults.

    Raises:
        ConfigError: as `world_config`.
    """
    pair = training_pair(seed, index, world_config(settings))
    return LabelledPair(pair.previous, pair.current, _world_labels(pair))


def world_config(settings: dict[str, Any]) -> TrainingConfig:
    """Check the settings of the embedded world's pairs.

    Raises:
        ConfigError: a setting is unknown or out of range.
    """
    try:
        return TrainingConfig.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(
            format_validation_error(error, TrainingConfig, prefix="examples.world")
        ) from error


def _world_labels(pair: TrainingPair) -> Labels:
    """Return the labels: objects are numbered from 0, their centres are means of their points."""
    then, now = pair.previous_truth, pair.current_truth
    ids = np.unique(now.object_id[now.object_id >= 0])
    elapsed_s = seconds_between(pair.previous.stamp_ns, pair.current.stamp_ns)
    current_object = _rows_of(now.object_id, ids)
    centre_m = _means(pair.current.xyz_m[:, :2], current_object, len(ids))
    motion_m = _means(now.velocity_mps, current_object, len(ids)) * np.float32(elapsed_s)
    return Labels(
        previous_object=_rows_of(then.object_id, ids),
        current_object=current_object,
        velocity_mps=now.velocity_mps,
        centre_m=np.stack((centre_m - motion_m, centre_m), axis=1).astype(np.float32),
    )


def _rows_of(object_id: I64, ids: I64) -> I16:
    """Return the row of each point's object among the sorted `ids`, -1 where it has none."""
    if not len(ids):
        return np.full(len(object_id), -1, np.int16)
    rows = np.minimum(np.searchsorted(ids, object_id), len(ids) - 1)
    return np.where(ids[rows] == object_id, rows, -1).astype(np.int16)


def _means(values: F32, rows: I16, count: int) -> F32:
    """Return (count,2) the mean of the values (N,2) of each object's points."""
    on = rows >= 0
    points = np.maximum(np.bincount(rows[on], minlength=count), 1)
    sums = [np.bincount(rows[on], weights=values[on, i], minlength=count) for i in range(2)]
    return (np.stack(sums, axis=1) / points[:, None]).astype(np.float32)


def _recorded_pairs(job: ShardTask) -> Iterator[LabelledPair]:
    """Draw pairs over all scenes of the split; a single scene is in both splits.

    Each shard draws from frames of its own first. Frames without tracks (nuScenes: all but key
    frames) are passed over; a data set with too few is drawn from again.

    Raises:
        ConfigError: no scene has two sweeps and tracks.
    """
    config, found = job.config, 0
    dataset = load_part("dataset", config.dataset or {}).make()
    names = sorted(dataset.scene_names)
    held_out = names[::HELD_OUT_EVERY] if len(names) > 1 else names
    wanted = held_out if job.split == "validation" else [n for n in names if n not in held_out]
    frames = [(name, i) for name in wanted or names for i in _later_frames(dataset.scene(name))]
    order = np.random.default_rng(config.seed).permutation(len(frames))
    # the others' frames after its own: a small data set may have none with tracks among its own
    rows = [*order[job.first // config.per_shard :: job.shards], *order]
    for row in itertools.cycle(rows):
        name, index = frames[row]
        pair = recorded_pair(dataset.scene(name), index, config.pair_s)
        if pair is not None:
            yield pair
            found += 1
        if found == job.count:
            return
        if not found and row == rows[-1]:
            break
    raise ConfigError("examples.dataset has no scene with two sweeps and tracks")


def _later_frames(scene: Scene) -> range:
    return range(1, len(scene)) if scene.has_sweeps else range(0)


def recorded_pair(scene: Scene, index: int, pair_s: float) -> LabelledPair | None:
    """Pair a frame's sweep with the earlier one whose age is nearest to `pair_s`.

    Returns None where the frame has no tracks. Where only the earlier one has none (nuScenes
    between key frames), its boxes are those of the frame moved back by their velocities.
    """
    now = scene.frame(index)
    if now.truth is None:
        return None
    ages = [
        (abs(seconds_between(scene.frame(other).stamp_ns, now.stamp_ns) - pair_s), other)
        for other in range(max(0, index - MAX_FRAMES_BACK), index)
    ]
    _, partner = min(ages)
    then = scene.frame(partner)
    before = _moved_back(now.truth, then.stamp_ns) if then.truth is None else then.truth
    previous, current = scene.sweep(partner), scene.sweep(index)
    labels = labels_from_tracks(previous, current, before, now.truth)
    return LabelledPair(previous, current, labels)


def _moved_back(truth: Truth, stamp_ns: int) -> Truth:
    """Return the boxes of known velocity where they were at an earlier time."""
    known = truth.select(np.flatnonzero(np.isfinite(truth.velocity_mps).all(axis=1)))
    way_m = known.velocity_mps * seconds_between(stamp_ns, truth.stamp_ns)
    centre_m = known.centre_m - np.column_stack([way_m, np.zeros(len(known))])
    return replace(known, stamp_ns=stamp_ns, centre_m=centre_m)

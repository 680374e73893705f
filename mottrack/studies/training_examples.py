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
from mottrack.core.frame import Frame
from mottrack.core.interfaces import Scene
from mottrack.core.objects import Truth
from mottrack.core.sweep import seconds_between
from mottrack.experiment.plugins import load_part
from mottrack.experiment.validation_message import format_validation_error
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.flow.pillarflow.training.examples import (
    BoxedSweep,
    ExampleBuilder,
    LabelledPair,
    Labels,
    labels_from_tracks,
)
from mottrack.flow.pillarflow.training.shards import write_shard
from mottrack.runs.tasks import OnStep, Outcome, Task
from mottrack.world import TrainingConfig, TrainingPair, training_pair
from mottrack.world.states import States

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
    older = tuple(scan.sweep for scan in pair.past[1:])
    return LabelledPair(pair.previous, pair.current, _world_labels(pair), older)


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
    """Return the labels: objects are numbered from 0, their centres are means of their points.

    The centre in another sweep is where that place on the rigid object was then.
    """
    now = pair.current_truth
    ids = np.unique(now.object_id[now.object_id >= 0])
    objects = [_rows_of(scan.truth.object_id, ids) for scan in pair.past]
    current_object = _rows_of(now.object_id, ids)
    centre_m = _means(pair.current.xyz_m[:, :2], current_object, len(ids))
    then_m = [_carried(pair, scan.states, ids, centre_m) for scan in pair.past]
    return Labels(
        previous_object=objects[0],
        current_object=current_object,
        velocity_mps=now.velocity_mps,
        centre_m=np.stack((then_m[0], centre_m, *then_m[1:]), axis=1).astype(np.float32),
        older_object=tuple(objects[1:]),
    )


def _carried(pair: TrainingPair, then: States, ids: I64, centre_m: F32) -> F32:
    """Return (K, 2) where places (K, 2) on the objects were, in the current ego frame."""
    now, pose = pair.current_states, pair.current.world_T_ego
    flat = np.column_stack([centre_m, np.zeros(len(ids))])
    arm_m = pose.apply(flat)[:, :2] - now.xy_m[ids]
    turn_rad = then.yaw_rad[ids] - now.yaw_rad[ids]
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned_m = np.column_stack(
        [c * arm_m[:, 0] - s * arm_m[:, 1], s * arm_m[:, 0] + c * arm_m[:, 1]]
    )
    height_m = pose.apply(flat)[:, 2:]
    world_m = np.column_stack([then.xy_m[ids] + turned_m, height_m])
    carried: F32 = pose.inverse().apply(world_m)[:, :2].astype(np.float32)
    return carried


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
        pair = recorded_pair(dataset.scene(name), index, (config.pair_s, *config.older_ages_s))
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


def recorded_pair(scene: Scene, index: int, ages_s: Sequence[float]) -> LabelledPair | None:
    """Pair a frame's sweep with the earlier ones whose ages are nearest to `ages_s`.

    The first is that of the pair, the others are older. Returns None where the frame has no tracks,
    or fewer sweeps lie before it. Where only an earlier one has none (nuScenes between key frames),
    its boxes are those of the frame moved back by their velocities.
    """
    now = scene.frame(index)
    if now.truth is None:
        return None
    stamps_ns = {i: scene.frame(i).stamp_ns for i in range(max(0, index - MAX_FRAMES_BACK), index)}
    past, newest = list[BoxedSweep](), index
    for age_s in ages_s:
        left = [i for i in stamps_ns if i < newest]
        if not left:
            return None
        away_s = {i: abs(seconds_between(stamps_ns[i], now.stamp_ns) - age_s) for i in left}
        newest = min(left, key=lambda i: (away_s[i], i))
        past.append(BoxedSweep(scene.sweep(newest), _truth_of(scene.frame(newest), now.truth)))
    previous, *older = past
    current = BoxedSweep(scene.sweep(index), now.truth)
    labels = labels_from_tracks(previous, current, older)
    return LabelledPair(previous.sweep, current.sweep, labels, tuple(one.sweep for one in older))


def _truth_of(then: Frame, now: Truth) -> Truth:
    return _moved_back(now, then.stamp_ns) if then.truth is None else then.truth


def _moved_back(truth: Truth, stamp_ns: int) -> Truth:
    """Return the boxes of known velocity where they were at an earlier time."""
    known = truth.select(np.flatnonzero(np.isfinite(truth.velocity_mps).all(axis=1)))
    way_m = known.velocity_mps * seconds_between(stamp_ns, truth.stamp_ns)
    centre_m = known.centre_m - np.column_stack([way_m, np.zeros(len(known))])
    return replace(known, stamp_ns=stamp_ns, centre_m=centre_m)

"""Make training examples for PillarFlow from the embedded world or a data set with tracks."""

from __future__ import annotations

import hashlib
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mottrack.core.arrays import F32, I16, I64
from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Scene
from mottrack.core.objects import Truth
from mottrack.core.processes import end_with_parent
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
from mottrack.runs.shard import Shard
from mottrack.runs.tasks import DIED
from mottrack.world import TrainingConfig, TrainingPair, training_pair

SPLITS = ("validation", "training")
COMPLETE = "complete"
"""Name of the empty file that says that a folder has all its shards."""
HELD_OUT_EVERY = 5
"""Every fifth recorded scene is held out: the usual 80 to 20 split."""
MAX_FRAMES_BACK = 10
"""The earlier sweep of a recorded pair is at most so many frames older: a second at 10 Hz."""
OnShard = Callable[[int, int], None]


@dataclass(frozen=True)
class ShardJob:
    """One shard to be made by a process of its own."""

    config: ExamplesConfig
    split: str
    """`training` or `validation`."""
    first: int
    """Index of the first example."""
    count: int
    """Number of examples."""
    shards: int
    """Number of shards of the split."""
    file: Path
    """Where the shard goes."""


def examples_folder(config: ExamplesConfig, parent: Path) -> Path:
    """Return a folder under `parent` whose name depends on all that changes the examples."""
    text = config.model_dump_json(exclude={"workers"})
    return parent / f"examples-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def make_examples(
    config: ExamplesConfig, folder: Path, on_shard: OnShard, part: Shard | None = None
) -> None:
    """Make the missing shards of a folder; an interrupted run is resumed.

    `on_shard` is called with (done, total) at the start and after each shard. With a `part` of
    I/N only every N-th shard is made, by one machine of N that share the folder: the last to end
    declares it complete.

    Raises:
        ConfigError: the data set has no pairs, or a process died.
    """
    whole = [job for split in SPLITS for job in _jobs(config, folder, split)]
    jobs = whole if part is None else whole[part.index - 1 :: part.count]
    missing = [job for job in jobs if not job.file.exists()]
    for split in SPLITS:
        (folder / split).mkdir(parents=True, exist_ok=True)
    done = len(jobs) - len(missing)
    on_shard(done, len(jobs))
    for _ in _made(missing, config.workers):
        done += 1
        on_shard(done, len(jobs))
    if all(job.file.exists() for job in whole):
        (folder / COMPLETE).touch()


def _made(jobs: Sequence[ShardJob], workers: int) -> Iterator[Path]:
    """Make shards side by side; yield the file of each that is there."""
    with ProcessPoolExecutor(workers, get_context("spawn"), end_with_parent) as pool:
        waiting = {pool.submit(_make_shard, job): job for job in jobs}
        for finished in as_completed(waiting):
            try:
                finished.result()
            except BrokenProcessPool as error:
                raise ConfigError(
                    f"a shard of examples is missing: {DIED}; the same command makes what is "
                    "missing, fewer examples.workers need less memory"
                ) from error
            yield waiting[finished].file


def await_examples(folder: Path, poll_s: float = 1.0) -> None:
    """Wait until another process has made them (the later ranks of `torchrun`)."""
    while not (folder / COMPLETE).exists():
        time.sleep(poll_s)


def _jobs(config: ExamplesConfig, folder: Path, split: str) -> Iterator[ShardJob]:
    total = config.pairs if split == "training" else config.validation_pairs
    firsts = range(0, total, config.per_shard)
    for first in firsts:
        file = folder / split / f"{first:07d}.safetensors"
        count = min(config.per_shard, total - first)
        yield ShardJob(config, split, first, count, len(firsts), file)


def _make_shard(job: ShardJob) -> None:
    pairs = _world_pairs(job) if job.config.dataset is None else _recorded_pairs(job)
    builder = ExampleBuilder(remove_ground=job.config.remove_ground)
    write_shard(job.file, [builder.build(pair) for pair in pairs])


def _world_pairs(job: ShardJob) -> Iterator[LabelledPair]:
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
        ConfigError: a setting is unknown or out of range.
    """
    try:
        config = TrainingConfig.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(
            format_validation_error(error, TrainingConfig, prefix="examples.world")
        ) from error
    pair = training_pair(seed, index, config)
    return LabelledPair(pair.previous, pair.current, _world_labels(pair))


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


def _recorded_pairs(job: ShardJob) -> Iterator[LabelledPair]:
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

"""Examples for training made ahead: from the embedded world or from a data set with tracks."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Scene
from mottrack.core.processes import end_with_parent
from mottrack.core.sweep import seconds_between
from mottrack.experiment.plugins import load_part
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.flow.pillarflow.training.labels import labels_from_tracks
from mottrack.flow.pillarflow.training.making import ExampleMaker, LabelledPair
from mottrack.studies.world_pairs import world_pair

SPLITS = ("validation", "training")
DONE = "complete"
OnShard = Callable[[int, int], None]


@dataclass(frozen=True)
class ShardJob:
    """One shard to be made, in a process of its own."""

    config: ExamplesConfig
    """What the examples are."""
    split: str
    """`training` or `validation`."""
    first: int
    """Index of the first example."""
    count: int
    """Number of examples."""
    file: Path
    """Where the shard goes."""


def examples_folder(config: ExamplesConfig, parent: Path) -> Path:
    """A folder under `parent` that changes with everything that changes the examples."""
    text = config.model_dump_json(exclude={"workers"})
    return parent / f"examples-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def make_examples(config: ExamplesConfig, folder: Path, on_shard: OnShard) -> None:
    """Make what is missing; an interrupted run goes on where it stopped."""
    jobs = [job for split in SPLITS for job in _jobs(config, folder, split)]
    missing = [job for job in jobs if not job.file.exists()]
    for split in SPLITS:
        (folder / split).mkdir(parents=True, exist_ok=True)
    done = len(jobs) - len(missing)
    on_shard(done, len(jobs))
    context = get_context("spawn")
    with ProcessPoolExecutor(config.workers, context, end_with_parent) as pool:
        for finished in as_completed([pool.submit(make_shard, job) for job in missing]):
            finished.result()
            done += 1
            on_shard(done, len(jobs))
    (folder / DONE).touch()


def await_examples(folder: Path, poll_s: float = 1.0) -> None:
    """Wait until another process has made them (the later ranks of `torchrun`)."""
    while not (folder / DONE).exists():
        time.sleep(poll_s)


def make_shard(job: ShardJob) -> None:
    """Make one shard."""
    pairs = _world_pairs(job) if job.config.dataset is None else _recorded_pairs(job)
    ExampleMaker(ground=job.config.ground).write(pairs, job.file)


def _jobs(config: ExamplesConfig, folder: Path, split: str) -> list[ShardJob]:
    total = config.pairs if split == "training" else config.validation_pairs
    return [
        ShardJob(
            config,
            split,
            first,
            min(config.per_shard, total - first),
            folder / split / f"{first:07d}.safetensors",
        )
        for first in range(0, total, config.per_shard)
    ]


def _world_pairs(job: ShardJob) -> Iterator[LabelledPair]:
    seed = job.config.seed if job.split == "training" else job.config.validation_seed
    for index in range(job.first, job.first + job.count):
        yield world_pair(seed, index, job.config.world)


def _recorded_pairs(job: ShardJob) -> Iterator[LabelledPair]:
    """Pairs drawn over all scenes; every fifth scene is held out, a single one is in both."""
    config = job.config
    dataset = load_part("dataset", config.dataset or {}).make()
    names = sorted(dataset.scene_names)
    held_out = names[::5] if len(names) > 1 else names
    wanted = held_out if job.split == "validation" else [n for n in names if n not in held_out]
    places = [(name, frame) for name in wanted or names for frame in _later(dataset.scene(name))]
    if not places:
        raise ConfigError("examples.dataset has no scene with two sweeps and tracks")
    rng = np.random.default_rng(config.seed)
    order = rng.permutation(max(len(places), job.first + job.count)) % len(places)
    for row in order[job.first : job.first + job.count]:
        name, frame = places[int(row)]
        pair = recorded_pair(dataset.scene(name), frame, config.pair_s)
        if pair is not None:
            yield pair


def _later(scene: Scene) -> range:
    return range(1, len(scene)) if scene.has_sweeps else range(0)


def recorded_pair(scene: Scene, index: int, pair_s: float) -> LabelledPair | None:
    """A frame's sweep and the earlier one whose age is nearest to `pair_s`; None without tracks."""
    now = scene.frame(index)
    ages = [
        (abs(seconds_between(scene.frame(other).stamp_ns, now.stamp_ns) - pair_s), other)
        for other in range(max(0, index - 10), index)
    ]
    _, partner = min(ages)
    then = scene.frame(partner)
    if now.truth is None or then.truth is None:
        return None
    previous, current = scene.sweep(partner), scene.sweep(index)
    labels = labels_from_tracks(previous, current, then.truth, now.truth)
    return LabelledPair(previous, current, labels)

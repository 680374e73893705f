"""Sets of training examples: a folder of shards, made by an executor, resumed and shared."""

from __future__ import annotations

import hashlib
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mottrack.core.errors import ConfigError
from mottrack.core.storage import discard_unfinished
from mottrack.experiment.plugins import load_part
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.runs.fingerprint import code_and_weights
from mottrack.runs.lock import only_driver
from mottrack.runs.run_folder import claim
from mottrack.runs.runner import Execution
from mottrack.runs.tasks import Outcome, Progress
from mottrack.studies import training_examples
from mottrack.studies.training_examples import ShardTask, world_config

SPLITS = ("validation", "training")
COMPLETE = "complete"
"""Name of the empty file that says that a folder has all its shards."""
PAIRS = Path(training_examples.__file__)
"""Code that decides the examples, outside of the packages that decide results of runs."""
IDENTITY = "examples.json"
"""Name of the file that tells what the shards were made with."""


@dataclass(frozen=True, eq=False)
class ExampleSet:
    """The examples of a training run, and their folder."""

    config: ExamplesConfig
    path: Path

    @classmethod
    def within(cls, parent: Path, config: ExamplesConfig) -> ExampleSet:
        """Return the set in a folder of `parent` whose name depends on all its settings."""
        digest = hashlib.sha256(config.model_dump_json().encode()).hexdigest()
        return cls(config, parent / f"examples-{digest[:12]}")

    @property
    def complete(self) -> Path:
        """The file that says that all shards are there."""
        return self.path / COMPLETE

    def fingerprint(self) -> dict[str, str]:
        """Return the settings' digest, the version and the code.

        Raises:
            ConfigError: the data set is unknown, or a setting of it is wrong.
        """
        dataset = self.config.dataset
        parts = [] if dataset is None else [load_part("dataset", dataset)]
        settings = hashlib.sha256(self.config.model_dump_json().encode()).hexdigest()
        return {"configuration": settings, **code_and_weights(parts, [PAIRS])}

    def scenes(self) -> tuple[str, ...]:
        """Return all scenes of the data set; none of the embedded world.

        Raises:
            ConfigError: a setting of the data set or of the world is wrong.
        """
        if self.config.dataset is None:
            world_config(self.config.world)
            return ()
        return tuple(load_part("dataset", self.config.dataset).make().scene_names)

    def tasks(self) -> list[ShardTask]:
        """Return the tasks that make its shards."""
        return [task for split in SPLITS for task in self._of(split)]

    def _of(self, split: str) -> Iterator[ShardTask]:
        config = self.config
        total = config.pairs if split == "training" else config.validation_pairs
        firsts = range(0, total, config.per_shard)
        for first in firsts:
            count, name = min(config.per_shard, total - first), f"{split}/{first:07d}"
            yield ShardTask(name, self.path, config, split, first, count, len(firsts))


def make_examples(examples: ExampleSet, *, execution: Execution, progress: Progress) -> None:
    """Make the missing shards of a set; an interrupted one is resumed.

    With a shard I/N of the execution only every N-th shard of the set is made, by one driver of N
    that share the folder: the last to end declares it complete.

    Raises:
        ConfigError: a setting is wrong; another driver works in the folder; its shards were made
            by other code; a node differs; or shards are missing at the end: each had an error or
            its processes died.
    """
    whole = examples.tasks()
    own = execution.shard.of(whole)
    with only_driver(examples.path, execution.shard):
        missing = [task for task in own if not task.file.exists()]
        if missing:
            scenes = examples.scenes()
            claim(examples.path / IDENTITY, examples.fingerprint())
            execution.executor.check({examples: scenes})
        progress.begin("examples", len(own), len(missing))
        outcomes = execution.executor.run(missing, progress)
        if all(task.file.exists() for task in whole):
            for split in SPLITS:
                discard_unfinished(examples.path / split)  # nobody writes any more
            examples.complete.touch()
    _require_made(examples, outcomes)


def _require_made(examples: ExampleSet, outcomes: Sequence[Outcome]) -> None:
    failed: dict[str, list[str]] = defaultdict(list)
    for outcome in outcomes:
        if outcome.error:
            failed[outcome.error].append(outcome.name)
    if failed:
        reasons = ", ".join(f"{' '.join(names)} ({error})" for error, names in failed.items())
        count = sum(map(len, failed.values()))
        raise ConfigError(
            f"{examples.path} lacks {count} of {len(outcomes)} shards that were to be made: "
            f"{reasons}; the same command makes what is missing"
        )


def await_examples(examples: ExampleSet, poll_s: float = 1.0) -> None:
    """Wait until another process has made them (the later ranks of `torchrun`)."""
    while not examples.complete.exists():
        time.sleep(poll_s)

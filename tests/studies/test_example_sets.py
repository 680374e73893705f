"""Sets of training examples: made in parts, interrupted, by two drivers, with faults."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mottrack.core import ConfigError
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.runs.here import Here
from mottrack.runs.lock import only_driver
from mottrack.runs.runner import Execution
from mottrack.runs.shard import Shard
from mottrack.studies.example_sets import IDENTITY, ExampleSet, make_examples

HERE = Execution(Here())


def toys(out: Path, *scenes: str) -> ExampleSet:
    dataset = {"kind": "toy_plugins:ToyDataset", "scenes": list(scenes or ("a", "b"))}
    counts = {"pairs": 3, "validation_pairs": 2, "per_shard": 1}
    return ExampleSet(ExamplesConfig(dataset=dataset, **counts), out)


def files_of(folder: Path) -> dict[str, bytes]:
    found = sorted(folder.rglob("*.safetensors"))
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, progress: Any) -> ExampleSet:
    made = toys(tmp_path_factory.mktemp("whole"))
    make_examples(made, execution=HERE, progress=progress)
    return made


def test_parts_and_an_interrupted_set_are_what_one_machine_makes(
    whole: ExampleSet, tmp_path: Path, progress: Any
) -> None:
    class Interrupts(type(progress)):
        def ends(self, _outcome: object) -> None:
            raise KeyboardInterrupt

    parts = toys(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        make_examples(parts, execution=HERE, progress=Interrupts())
    assert len(files_of(tmp_path)) == 1
    for part in (Shard(2, 2), Shard(1, 2)):
        assert not parts.complete.exists()
        make_examples(parts, execution=replace(HERE, shard=part), progress=progress)
    assert progress.todo == 2  # the first of the three was there
    assert parts.complete.exists()
    assert len(files_of(whole.path)) == 5
    assert files_of(tmp_path) == files_of(whole.path)


def test_shards_that_cannot_be_made_are_named(tmp_path: Path, progress: Any) -> None:
    faulty = toys(tmp_path, "a", "poison")
    words = r"lacks \d of 5 shards .*: training/\d+.* \(\S+ point 7 is nan.*\); the same command"
    with pytest.raises(ConfigError, match=words):
        make_examples(faulty, execution=HERE, progress=progress)
    assert len(files_of(tmp_path)) >= 2  # those of the other scene
    assert not faulty.complete.exists()


def test_drivers_of_other_parts_may_work_in_the_folder_and_no_others(
    whole: ExampleSet, progress: Any
) -> None:
    other, same = (replace(HERE, shard=Shard(k, 2)) for k in (1, 2))
    with only_driver(whole.path, Shard(2, 2)):
        make_examples(whole, execution=other, progress=progress)
        for execution in (same, HERE):
            with pytest.raises(ConfigError, match=r"in use by process \d+ on "):
                make_examples(whole, execution=execution, progress=progress)


def test_shards_of_other_code_are_not_mixed(tmp_path: Path, progress: Any) -> None:
    made = toys(tmp_path)
    make_examples(made, execution=HERE, progress=progress)
    file = tmp_path / IDENTITY
    file.write_text(json.dumps(json.loads(file.read_text()) | {"code": "of yesterday"}))
    make_examples(made, execution=HERE, progress=progress)  # nothing is missing, nothing is mixed
    next(tmp_path.glob("training/*")).unlink()
    with pytest.raises(ConfigError, match=r"results of another code \(examples\.json\)"):
        make_examples(made, execution=HERE, progress=progress)


@pytest.mark.parametrize("settings", [{"world": {"speed": 3}}, {"dataset": {"kind": "kity"}}])
def test_a_wrong_setting_ends_before_the_first_shard(
    settings: dict[str, Any], tmp_path: Path, progress: Any
) -> None:
    with pytest.raises(ConfigError, match=r"speed|kity"):
        make_examples(
            ExampleSet(ExamplesConfig(**settings), tmp_path), execution=HERE, progress=progress
        )
    assert not files_of(tmp_path)

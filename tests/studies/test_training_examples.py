"""Training examples made in parts, and what happens when a process dies meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest

from mottrack.core import ConfigError
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.runs.shard import Shard
from mottrack.studies.training_examples import COMPLETE, make_examples


def config(*scenes: str) -> ExamplesConfig:
    return ExamplesConfig(
        dataset={"kind": "toy_plugins:ToyDataset", "scenes": list(scenes)},
        pairs=3,
        validation_pairs=2,
        per_shard=1,
        workers=1,
    )


def files_of(folder: Path) -> dict[str, bytes]:
    found = sorted(folder.rglob("*.safetensors"))
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


def test_parts_make_what_one_machine_makes(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    make_examples(config("a", "b"), tmp_path / "whole", lambda *_: None)
    for part in (Shard(2, 2), Shard(1, 2)):
        assert not (tmp_path / "parts" / COMPLETE).exists()
        make_examples(config("a", "b"), tmp_path / "parts", lambda *n: told.append(n), part)
    assert (tmp_path / "parts" / COMPLETE).exists()
    assert told == [(0, 2), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3), (3, 3)]
    assert len(files_of(tmp_path / "whole")) == 5
    assert files_of(tmp_path / "parts") == files_of(tmp_path / "whole")


def test_a_process_that_dies_is_told_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"its process died .* the same command makes what is"):
        make_examples(config("killed"), tmp_path, lambda *_: None)
    assert not (tmp_path / COMPLETE).exists()

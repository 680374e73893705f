"""The scripts of docs/machines.md run every shard once, each into a folder of its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
import yaml

from mottrack.runs.shard import Shard

from .conftest import REPOSITORY, blocks

PAGE = REPOSITORY / "docs" / "machines.md"
JOBS = 16


@pytest.fixture
def told(tmp_path: Path) -> Path:
    """Folder of a ``mottrack`` that writes its arguments and exits with 3, for scenes that fail."""
    script = tmp_path / "mottrack"
    script.write_text('#!/bin/sh\necho "$@"\nexit 3\n')
    script.chmod(0o755)
    return tmp_path


def arguments(command: list[str], told: Path, **variables: str) -> list[str]:
    environment = {**os.environ, "PATH": f"{told}:{os.environ['PATH']}", **variables}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert not done.stderr
    return [*done.stdout.split(), str(done.returncode)]


def assert_each_once(found: list[list[str]]) -> None:
    shards = [Shard.parse(words[words.index("--shard") + 1]) for words in found]
    assert shards == [Shard(k, JOBS) for k in range(1, JOBS + 1)]
    assert len({words[words.index("--out") + 1] for words in found}) == JOBS


def test_a_slurm_array(told: Path) -> None:
    (script,) = [code for code in blocks(PAGE, "bash") if "#SBATCH" in code]
    assert f"#SBATCH --array=1-{JOBS}\n" in script
    file = told / "job.sh"
    file.write_text(script)
    tasks = [str(k) for k in range(1, JOBS + 1)]
    found = [
        arguments(["bash", str(file)], told, SLURM_ARRAY_TASK_ID=k, SCRATCH="/scratch")
        for k in tasks
    ]
    assert_each_once(found)
    assert {words[-1] for words in found} == {"3"}  # Slurm shows that scenes have failed


def test_an_indexed_job_of_kubernetes(told: Path) -> None:
    (text,) = [code for code in blocks(PAGE, "") if "completionMode" in code]
    job = yaml.safe_load(text)["spec"]
    assert (job["completions"], job["completionMode"]) == (JOBS, "Indexed")
    pod = job["template"]["spec"]
    (container,) = pod["containers"]
    mounted = {mount["name"] for mount in container["volumeMounts"]}
    assert mounted == {volume["name"] for volume in pod["volumes"]}
    command = container["command"]
    found = [arguments(command, told, JOB_COMPLETION_INDEX=str(k)) for k in range(JOBS)]
    assert_each_once(found)
    assert {words[-1] for words in found} == {"0"}  # else it would be restarted for ever

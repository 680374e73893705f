"""Compiled functions work where neither the package's folder nor a home can be written."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from mottrack.compiled import temporary_cache

PROGRAM = """
from mottrack.compiled import compiled

@compiled
def twice(x: float) -> float:
    return 2.0 * x

@compiled(nogil=True)
def four_times(x: float) -> float:
    return twice(twice(x))

print(four_times(1.5), sum(four_times.stats.cache_misses.values()))
"""


@pytest.fixture
def locked(tmp_path: Path) -> Path:
    """A program in a folder in which no file can be made, even by root."""
    program = tmp_path / "package" / "program.py"
    program.parent.mkdir()
    program.write_text(PROGRAM)
    (program.parent / "__pycache__").write_text("a file where numba would make a folder")
    return program


def run(program: Path, temporary: Path) -> list[str]:
    blocked = str(program)  # a file: no folder can be made below it
    places = {"HOME": blocked, "XDG_CACHE_HOME": f"{blocked}/cache", "TMPDIR": str(temporary)}
    given = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    root = str(Path(__file__).resolve().parents[1])
    done = subprocess.run(
        [sys.executable, str(program)],
        env={**given, **places, "PYTHONPATH": root},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_a_temporary_cache_serves_the_next_process(locked: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert run(locked, temporary) == ["6.0", "1"]
    assert (temporary / f"mottrack-{os.getuid()}").stat().st_mode & 0o777 == 0o700
    assert run(locked, temporary) == ["6.0", "0"]


def test_a_folder_that_others_can_write_is_not_used(locked: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    folder = temporary / f"mottrack-{os.getuid()}"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    assert run(locked, temporary)[0] == "6.0"
    assert not list(folder.iterdir())


def test_nothing_is_writable(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", none)
    assert temporary_cache() is None

"""Compiled functions work where neither the package's folder nor a home can be written."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import pytest

from mottrack.compiled import compilation_told, temporary_cache

REPOSITORY = Path(__file__).resolve().parents[1]

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


def test_no_compiled_function_assigns_an_array_to_a_slice() -> None:
    """Numba compiles the text of the error for unequal shapes: one to two seconds each."""
    found = []
    for path in sorted((REPOSITORY / "mottrack").rglob("*.py")):
        for function in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(function, ast.FunctionDef):
                continue
            if not any("compiled" in ast.unparse(d) for d in function.decorator_list):
                continue
            found += [f"{path.name}:{n.lineno}" for n in ast.walk(function) if copies_array(n)]
    assert not found


def copies_array(node: ast.AST) -> bool:
    if not isinstance(node, ast.Assign) or isinstance(node.value, ast.Constant):
        return False
    targets = [t for one in node.targets for t in ast.walk(one) if isinstance(t, ast.Subscript)]
    return any(isinstance(part, ast.Slice) for t in targets for part in ast.walk(t.slice))


def test_a_compilation_is_told_once() -> None:
    @numba.njit
    def twice(x: float) -> float:
        return 2.0 * x

    told: list[None] = []
    with compilation_told(lambda: told.append(None)):
        twice(1.0)
        first = len(told)
        twice(2.0)
    twice(1)  # another type, but outside the block
    assert len(told) == first >= 1

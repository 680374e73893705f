"""What is left of the memory, and the words before the kernel ends a process."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from mottrack import cli
from mottrack.core import memory
from mottrack.core.memory import fitting, left_bytes, warn_when_scarce
from mottrack.runs.tasks import reason

GIB = 1 << 30


@pytest.fixture
def container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "names", [("memory.max", "memory.current"), ("memory/memory.limit_in_bytes",) * 2]
)
def test_a_container_of_two_gigabytes(names: tuple[str, str], container: Path) -> None:
    """Cached pages of files do not count; without a limit the machine counts."""
    whole = left_bytes()
    assert whole is not None
    version_1 = "limit" in names[0]
    used = "memory/memory.usage_in_bytes" if version_1 else names[1]
    stat = "memory/memory.stat" if version_1 else "memory.stat"
    (container / "memory").mkdir()
    (container / names[0]).write_text(f"{2 * GIB}\n")
    (container / used).write_text(f"{3 * GIB // 2}\n")
    (container / stat).write_text(f"anon 5\ninactive_file {GIB // 4}\n")
    assert left_bytes() == min(3 * GIB // 4, whole) or whole < GIB
    assert fitting(8, GIB // 4) == 3
    assert fitting(8, 5 * GIB) == 1
    (container / names[0]).write_text("max\n")
    assert (left_bytes() or 0) > GIB // 2


def test_a_word_is_said_once_before_the_memory_ends(
    container: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (container / "memory.max").write_text("1000000\n")
    (container / "memory.current").write_text("999999\n")
    warn_when_scarce()
    end = time.monotonic() + 10.0
    while time.monotonic() < end and not (printed := capsys.readouterr().err):
        time.sleep(0.01)
    assert printed == (
        "mottrack: memory is exhausted (0 MiB left): use fewer --workers, or a machine or "
        "container with more\n"
    )


def test_a_request_that_fails_is_told_in_the_same_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_much() -> None:
        raise MemoryError

    monkeypatch.setattr(cli, "app", too_much)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "memory is exhausted: use fewer --workers" in capsys.readouterr().err
    assert "memory is exhausted" in reason(MemoryError())

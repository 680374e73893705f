"""The page of faults shows what the code prints now, row by row."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.fuzz.faults_table import SECTIONS, row
from tests.fuzz.targets import write_all

PAGE = Path(__file__).resolve().parents[2] / "docs/faults.md"
ROWS = {name: printed for faults in SECTIONS.values() for name, printed in faults.items()}
SLOW = ("A9 `config", "A11 KITTI", "B", "C8 in timings", "C12", "D2", "D3 weights", "E1")
"""Rows that start processes, or take a second: their own tests are in tests/cli and tests/runs."""
FOREIGN = ("Traceback", "Error(", "Errno", "codec can't", "Exceeds the limit", "`` |")
"""Of a traceback, of Python's own errors, and a row for which nothing was printed."""
NUMBER = re.compile(r"([A-F]\d+) ")


def shown() -> list[str]:
    return [line for line in PAGE.read_text().splitlines() if NUMBER.match(line[2:])]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mcap", reason="needs the extra: pip install mottrack[ros]")
    folder = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTTRACK_CACHE", str(folder / "cache"))
        write_all(folder)
    return folder


def test_the_page_has_each_row_once_and_no_foreign_words() -> None:
    lines = shown()
    assert [line[2:].split(" | ")[0] for line in lines] == list(ROWS)
    for line in lines:
        assert not any(word in line for word in FOREIGN), line


def test_what_is_printed_is_what_the_page_shows(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="needs the extra: pip install mottrack[pillarflow]")
    monkeypatch.setenv("MOTTRACK_CACHE", str(root / "cache"))
    quick = {name: printed for name, printed in ROWS.items() if not name.startswith(SLOW)}
    assert len(quick) > 60
    found = [row(name, printed(root)) for name, printed in quick.items()]
    kept = [line for line in shown() if not line[2:].startswith(SLOW)]
    assert found == kept

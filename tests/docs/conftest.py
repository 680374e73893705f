"""The documentation files of the repository, and the scripts that generate pages."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TEXTS = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^``` ?(\w*|{.*})\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks(file: Path, language: str) -> list[str]:
    """Return the code blocks of a file in one language, in order."""
    return [code for kind, code in BLOCK.findall(file.read_text("utf-8")) if kind == language]


def names(files: list[Path]) -> list[str]:
    return [str(file.relative_to(REPOSITORY)) for file in files]


@pytest.fixture
def page_makers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "docs" / "generate"))
    for name in ("pieces", "fields", "configuration", "command_line", "python_reference", "write"):
        monkeypatch.delitem(sys.modules, name, raising=False)

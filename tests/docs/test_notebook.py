"""The notebooks of the examples run from top to bottom, and the objects show themselves."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from .conftest import REPOSITORY

NOTEBOOKS = sorted((REPOSITORY / "examples").glob("*.ipynb"))


def shown_by(code: str, namespace: dict[str, Any]) -> object:
    """Execute a cell; return the value of its last expression, which a notebook would show."""
    tree = ast.parse(code)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), namespace)  # noqa: S102
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), namespace)  # noqa: S307


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_every_cell_of(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    notebook = json.loads(path.read_text("utf-8"))
    assert notebook["nbformat"] == 4
    namespace: dict[str, Any] = {}
    shown = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []  # figures would be those of one machine and one day
            shown.append(shown_by("".join(cell["source"]), namespace))
    pictures = [value._repr_html_() for value in shown if hasattr(value, "_repr_html_")]
    assert sum("<svg" in text for text in pictures) >= 2
    assert any("data:image/png" in text for text in pictures)
    assert any("<table>" in text for text in pictures)
    assert all(len(repr(value)) < 300 for value in shown if hasattr(value, "_repr_html_"))


def test_there_is_a_notebook() -> None:
    assert NOTEBOOKS

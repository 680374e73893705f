"""What a configuration can name, each with one line that says what it is."""

from __future__ import annotations

import ast
from importlib.util import find_spec
from pathlib import Path

from mottrack.datasets import DATASETS
from mottrack.flow import FLOWS
from mottrack.objects import OBJECTS
from mottrack.trackers import TRACKERS

TABLES = {
    "datasets": DATASETS,
    "objects": OBJECTS,
    "flows": FLOWS,
    "trackers": TRACKERS,
}


def catalogue() -> dict[str, dict[str, str]]:
    """Group to names to summary; read from the sources, so that nothing heavy is imported."""
    return {
        group: {name: _summary(place) for name, place in table.items()}
        for group, table in TABLES.items()
    }


def _summary(place: str) -> str:
    module, _, name = place.partition(":")
    tree = _parse(module)
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return (ast.get_docstring(node) or "").partition("\n")[0]
        if (
            isinstance(node, ast.ImportFrom)
            and node.module
            and name in [a.name for a in node.names]
        ):
            return _summary(f"{node.module}:{name}")  # a package that re-exports it
    return ""


def _parse(module: str) -> ast.Module:
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return ast.Module(body=[], type_ignores=[])
    return ast.parse(Path(spec.origin).read_text(encoding="utf-8"))

"""Columns of a user's own for slices, from a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mottrack.core.errors import DataError
from mottrack.eval.tracked_scenes import TrackedScenes, Values
from mottrack.formats.text_rows import read_lines

SCENE, OBJECT, FRAME = "scene", "id", "frame"
_INTEGERS = (OBJECT, FRAME)


@dataclass(frozen=True)
class OwnColumns:
    """The rows of a file: to what each belongs, and its values."""

    path: Path
    values: Mapping[str, Mapping[str, Values]]
    """Column to scene to values."""

    def added_to(self, scenes: TrackedScenes) -> TrackedScenes:
        """Return the scenes with these columns too.

        Raises:
            DataError: the file names none of the scenes.
        """
        names = [result.name for result in scenes.results]
        named = {scene for by_scene in self.values.values() for scene in by_scene}
        if not named & set(names):
            raise DataError(self.path, SCENE, sorted(named)[:1], f"a scene such as {names[0]}")
        own = {
            column: [by_scene.get(name, {}) for name in names]
            for column, by_scene in self.values.items()
        }
        return replace(scenes, columns={**scenes.columns, **own})


def read_own_columns(path: Path) -> OwnColumns:
    """Read a CSV file with a header: `scene`, at will `id` and `frame`, and any columns of values.

    A row without `id` holds for the whole scene, one with `id` for a true object, one with `frame`
    too (row of the key frame, from 0) for its box there. The most particular value counts.

    Raises:
        DataError: a column or a cell is missing, or an id is no integer.
    """
    rows = list(csv.reader(read_lines(path)))
    head = [name.strip() for name in rows[0]] if rows else []
    _check_header(path, head)
    values: dict[str, dict[str, dict[object, str | float]]] = {}
    for number, row in enumerate(rows[1:], 2):
        if not row:
            continue
        if len(row) != len(head):
            raise DataError(path, f"line {number}", f"{len(row)} cells", f"{len(head)}")
        cells = dict(zip(head, map(str.strip, row), strict=True))
        key = _key(path, number, cells)
        for column in head:
            if column not in (SCENE, *_INTEGERS) and cells[column]:
                scene = values.setdefault(column, {}).setdefault(cells[SCENE], {})
                scene[key] = cells[column]
    return OwnColumns(path, values)


def _check_header(path: Path, head: Sequence[str]) -> None:
    own = [name for name in head if name not in (SCENE, *_INTEGERS)]
    if SCENE not in head or not own or len(set(head)) < len(head):
        raise DataError(path, "header", ",".join(head), "scene, and columns of values, each once")
    if FRAME in head and OBJECT not in head:
        raise DataError(path, "header", ",".join(head), "id beside frame")


def _key(path: Path, number: int, cells: Mapping[str, str]) -> object:
    """Return what a row belongs to: (frame, identity), an identity, or None for its scene."""
    found = {}
    for name in _INTEGERS:
        text = cells.get(name, "")
        if text:
            if not text.isdecimal():
                raise DataError(path, f"line {number}, {name}", text, "an integer of at least 0")
            found[name] = int(text)
    if OBJECT not in found:
        return None
    return (found[FRAME], found[OBJECT]) if FRAME in found else found[OBJECT]

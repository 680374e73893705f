"""Probable label errors of one run or several as JSON and tables."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.eval.label_errors.suspects import Suspect
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables

Found = Mapping[str, list[Suspect] | str]
"""Run to its suspects, or to why none can be sought."""
HEADS = ("scene", "suspected", "class", "label says", "track", "frames", "score", "m/s", "agree")


def write_outputs(folder: Path, found: Found) -> list[TextTable]:
    """Write `label_errors.json` and a table for each run; return the tables."""
    content = {
        name: run if isinstance(run, str) else [asdict(one) for one in run]
        for name, run in found.items()
    }
    plain = json.loads(json.dumps(content))  # tuples become lists
    write_text(folder / "label_errors.json", json.dumps(strict(plain), indent=1, allow_nan=False))
    tables = [suspect_table(name, run) for name, run in found.items()]
    write_tables(tables, folder / "tables")
    return tables


def suspect_table(name: str, run: list[Suspect] | str) -> TextTable:
    """Return a line for each suspect of a run, the best supported first."""
    rows: list[tuple[Cell, ...]] = []
    for one in () if isinstance(run, str) else run:
        frames = f"{one.frames} in {one.first} to {one.last}"
        names = (one.scene, one.kind, one.label, one.labelled or "nothing", one.track_id, frames)
        rows.append((*names, one.score, one.speed_mps, ", ".join(one.agreed)))
    note = run if isinstance(run, str) else "Look at each in the player of mottrack report."
    safe = "".join(c if c.isalnum() else "_" for c in name)
    columns = tuple(Column(head, 2) for head in HEADS)
    title = f"Probable label errors, {name}"
    return TextTable(f"label_errors_{safe}", title, columns, tuple(rows), note)

"""The evaluation as files and as a table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.eval.waymo.metrics import WaymoMetrics
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables

Rows = Mapping[tuple[str, int], WaymoMetrics]


def write_outputs(folder: Path, rows: Rows) -> TextTable:
    """Write `waymo.json` and the table; return the table of the parts that have truth."""
    content = {f"{part} LEVEL_{level}": asdict(m) for (part, level), m in rows.items()}
    write_text(folder / "waymo.json", json.dumps(content, indent=1, allow_nan=False))
    heads = ("MOTA", "MOTP", "miss", "mismatch", "FP")
    columns = (
        *(Column("type"), Column("level", 0)),
        *(Column(head, 4) for head in heads),
        *(Column("cutoff", 2), Column("true boxes", 0)),
    )
    table: list[tuple[Cell, ...]] = [
        (part, level, m.mota, m.motp, m.miss, m.mismatch, m.false_positive, m.cutoff, m.truth)
        for (part, level), m in rows.items()
        if m.truth
    ]
    note = "At the score cutoff of the best MOTA; all 0 where none is above 0. MOTP is 1 - IoU."
    made = TextTable("waymo", "Waymo tracking", columns, tuple(table), note)
    write_tables([made], folder / "tables")
    return made

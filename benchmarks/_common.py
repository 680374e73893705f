"""What every benchmark script needs: its options, a table on the terminal, figures as JSON."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
"""Recorded drives, which are no part of the project."""


def arguments(description: str, **more: Callable[[str], Any]) -> argparse.Namespace:
    """`--json FILE`, `--quick` and an option `--name VALUE` for each of `more`."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--quick", action="store_true", help="a small size, in seconds")
    for name, kind in more.items():
        parser.add_argument(f"--{name}", type=kind, default=None)
    return parser.parse_args()


def recorded_data(chosen: Path | None) -> Path:
    """The folder of recorded drives; ends the script without an error where there is none."""
    if chosen is not None or SHARED.is_dir():
        return chosen or SHARED
    print("skipped: there are no recorded drives in ../shared/data; name their folder with --data")
    raise SystemExit(0)


def report(rows: Sequence[dict[str, Any]], json_file: Path | None = None) -> None:
    """Prints rows with the same keys as a table and writes them as JSON where asked."""
    keys = list(rows[0])
    cells = [keys, *([_text(row[key]) for key in keys] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(keys))]
    for line in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    if json_file is not None:
        json_file.write_text(json.dumps(rows, indent=2) + "\n")


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)

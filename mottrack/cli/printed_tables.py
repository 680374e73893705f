"""Tables as every command prints them: as wide as the terminal, nothing cut off."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from mottrack.formats.text_table import TextTable

NARROWEST = 60
"""Characters of a line of a table: below it the numbers of a row no longer stand side by side."""


def table_width() -> int:
    """Return how many characters a line of a table may have."""
    return max(shutil.get_terminal_size().columns, NARROWEST)


def print_tables(tables: Iterable[TextTable]) -> None:
    """Print tables with their titles and notes."""
    from mottrack.formats.text_table import fitted

    for table in tables:
        typer.echo(f"{fitted(table, table_width())}\n")

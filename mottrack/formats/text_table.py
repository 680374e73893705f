"""A table of results, written for a terminal and as CSV, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mottrack.core.pictures import table as html_table
from mottrack.core.printed import printable
from mottrack.core.storage import write_text

Cell = str | float | int | None
MISSING = "–"
GAP = 2
"""Blanks between two columns of `aligned`."""
SHORTEST_NAME = 12
"""Characters that the first column of a table may have on the narrowest terminal."""
LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"$<$",
    ">": r"$>$",
    "|": r"\textbar{}",
    "±": r"$\pm$",
    "×": r"$\times$",
    "−": "$-$",
    "²": r"$^2$",
    "→": r"$\rightarrow$",
    "…": r"\dots{}",
    "–": "--",
    "\n": " ",
}


@dataclass(frozen=True)
class Column:
    """Heading of a column and how its numbers are written."""

    name: str
    digits: int = 3
    signed: bool = False

    def text(self, cell: Cell) -> str:
        """Return a cell as people read it; a number that does not exist is a dash."""
        if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
            return MISSING
        if isinstance(cell, str | int):
            return printable(str(cell))
        return f"{cell:{'+' if self.signed else ''}.{self.digits}f}"


@dataclass(frozen=True)
class TextTable:
    """Rows of texts and numbers under a title."""

    name: str
    """Name of its files."""
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def texts(self) -> list[list[str]]:
        """Return the cells as people read them."""
        return [
            [column.text(cell) for column, cell in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        head = [column.name for column in self.columns]
        return html_table(self.title, head, self.texts(), self.note)


def to_csv(table: TextTable) -> str:
    """Return comma separated values with all digits; what does not exist is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    writer.writerows([_plain(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def to_markdown(table: TextTable) -> str:
    """Return a GitHub table under its title."""
    head = [_markdown(column.name) for column in table.columns]
    rule = [":--" if _is_text(table, k) else "--:" for k in range(len(head))]
    rows = [[_markdown(cell) for cell in row] for row in table.texts()]
    lines = ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]
    note = f"\n{table.note}\n" if table.note else ""
    return f"**{table.title}**\n\n" + "\n".join(lines) + "\n" + note


def to_latex(table: TextTable) -> str:
    """Return a table in the style of the package booktabs, with its caption and label."""
    align = "".join("l" if _is_text(table, k) else "r" for k in range(len(table.columns)))
    rows = [[column.name for column in table.columns], *table.texts()]
    lines = [" & ".join(latex(cell) for cell in row) + r" \\" for row in rows]
    caption = latex(" ".join(filter(None, (table.title + ".", table.note))))
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{caption}}}",
            rf"\label{{tab:{table.name.replace('_', '-')}}}",
            rf"\begin{{tabular}}{{{align}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def latex(text: str) -> str:
    """Return the text with everything escaped that LaTeX would take for a command."""
    return "".join(LATEX.get(character, character) for character in text)


def write_tables(tables: Sequence[TextTable], folder: Path) -> None:
    """Write NAME.csv, NAME.md and NAME.tex of every table."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        write_text(folder / f"{table.name}.csv", to_csv(table))
        write_text(folder / f"{table.name}.md", to_markdown(table))
        write_text(folder / f"{table.name}.tex", to_latex(table))


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of as many cells each for a terminal: the first column left, others right."""
    lines = [[printable(cell) for cell in line] for line in lines]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])])
        for line in lines
    )


def fitted(table: TextTable, width: int) -> str:
    """Return a table for a terminal of ``width`` characters; nothing is cut off.

    Names that are too long are wrapped, and left out where they repeat that of the row above;
    columns that do not fit follow below, under the first one.
    """
    lines = [[column.name for column in table.columns], *table.texts()]
    blocks = [_ruled(block) for block in _blocks(lines, width)]
    note = [textwrap.fill(table.note, width)] if table.note else []
    return "\n".join([*textwrap.wrap(table.title, width), "\n\n".join(blocks), *note])


def _blocks(lines: Sequence[Sequence[str]], width: int) -> list[list[list[str]]]:
    """Split the columns into groups that fit, each after the first column."""
    fits = len(aligned(lines).partition("\n")[0]) <= width
    most = width if fits else max(width // 3, SHORTEST_NAME)
    names = [line[0] for line in lines]
    first = [
        [""] if name == before else _wrapped(name, most)
        for name, before in zip(names, ["", *names], strict=False)
    ]
    widths = [max(len(part) for name in first for part in name)]
    widths += [max(map(len, column)) for column in list(zip(*lines, strict=True))[1:]]
    groups: list[list[int]] = [[]]
    for k in range(1, len(widths)):
        wanted = widths[0] + sum(GAP + widths[i] for i in (*groups[-1], k))
        if groups[-1] and wanted > width:
            groups.append([])
        groups[-1].append(k)
    return [
        [
            [part, *(line[k] if row == 0 else "" for k in group)]
            for line, name in zip(lines, first, strict=True)
            for row, part in enumerate(name)
        ]
        for group in groups
    ]


def _wrapped(name: str, most: int) -> list[str]:
    """Break a name after a plus, colon, underscore or blank, or anywhere if it has none of them."""
    name, parts = printable(name), []
    while len(name) > most:
        cut = max(name.rfind(mark, 0, most) for mark in "+:_ ") + 1
        parts.append(name[: cut or most])
        name = name[cut or most :]
    return [*parts, name]


def _ruled(lines: list[list[str]]) -> str:
    head, *rows = (line.rstrip() for line in aligned(lines).split("\n"))
    return "\n".join([head, "-" * max(map(len, (head, *rows))), *rows])


def _is_text(table: TextTable, k: int) -> bool:
    return any(isinstance(row[k], str) for row in table.rows)


def _plain(cell: Cell) -> Cell:
    if isinstance(cell, str):
        return printable(cell)
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _markdown(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ")

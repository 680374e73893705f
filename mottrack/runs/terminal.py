"""What a run shows on the terminal: a progress bar while it works, tables at its end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from mottrack.formats.text_table import TextTable
from mottrack.runs.comparison import Comparison, ScoredRun
from mottrack.runs.comparison_tables import (
    FLOW_PARTS,
    VELOCITY_PARTS,
    compact,
    comparison_tables,
    leading_differences,
)
from mottrack.runs.workers import Outcome


class TerminalProgress:
    """One bar a run; scenes count in full when they are done and in part while they work."""

    def __init__(self, console: Console | None = None) -> None:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("scenes"),
            TimeRemainingColumn(),
            TextColumn("[dim]{task.fields[now]}"),
        )
        self._progress = Progress(*columns, console=console)
        self._task = self._progress.add_task("", visible=False, now="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def begin(self, title: str, scenes: int, todo: int) -> None:
        """Starts a new bar; scenes that are there already count as done."""
        resumed = f"{scenes - todo} already there" if todo < scenes else ""
        self._task = self._progress.add_task(
            title or "run", total=scenes, completed=scenes - todo, now=resumed
        )

    def frames(self, scene: str, done: int, total: int) -> None:
        """Names the scene that works and how far it is."""
        self._progress.update(self._task, now=f"{scene} {done}/{total}")

    def scene_ends(self, outcome: Outcome) -> None:
        """Moves the bar; what went wrong is told in full at the end."""
        failed = f"{outcome.scene} failed" if outcome.error else ""
        self._progress.update(self._task, advance=1, now=failed)


FILE_WIDTH = 140  # columns of a table that goes into a file or a pipe


def print_comparison(comparison: Comparison, console: Console | None = None) -> None:
    """Prints the tables of a comparison and where everything is stored."""
    console = console or Console()
    if not console.is_terminal:
        console.width = FILE_WIDTH
    tables = {table.name: table for table in comparison_tables(comparison)}
    tables.pop("differences", None)
    runs = [run for run in comparison.runs if run.report.finished]
    titles = [run.title for run in runs]
    if len(runs) > 1:
        tables.pop("latency")  # the whole of it is among the stored tables
    for name, parts in (("velocity", VELOCITY_PARTS), ("flow", FLOW_PARTS)):
        if name in tables:
            tables[name] = compact(tables[name], titles, parts)
    for table in (*tables.values(), *leading_differences(comparison.differences)):
        console.print(rich_table(table))
    for line in _closing_lines(comparison, runs):
        console.print(line, highlight=False, soft_wrap=True)


def _closing_lines(comparison: Comparison, runs: Sequence[ScoredRun]) -> Iterator[str]:
    """Whether each run kept up with its sensor, what failed, and where everything is."""
    for run in runs:
        if run.latency is not None:
            yield escape(f"latency {run.title}: {run.latency.verdict}")
    for name, reason in comparison.failed.items():
        yield f"[red]failed[/] {escape(f'{name}: {reason}')}"
    yield escape(f"figures: {comparison.out / 'scores.json'}")
    if runs:
        yield escape(f"tables:  {comparison.out / 'tables'}")


def rich_table(table: TextTable) -> Table:
    """The table as the terminal shows it; rows of the same first cell form a group."""
    shown = Table(*(column.name for column in table.columns), title=table.title)
    shown.caption = table.note or None
    texts = table.texts()
    grouped = len({cells[0] for cells in texts}) < len(texts)
    before = None
    for cells in texts:
        if grouped and cells[0] != before:
            shown.add_section()
        shown.add_row("" if cells[0] == before else cells[0], *cells[1:])
        before = cells[0]
    return shown

"""Terminal output of runs: a progress bar, and tables at the end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from mottrack.formats.text_table import TextTable
from mottrack.runs.comparison import Comparison
from mottrack.runs.comparison_tables import (
    FLOW_PARTS,
    VELOCITY_PARTS,
    compact,
    comparison_tables,
    leading_differences,
)
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.tasks import Outcome


class TerminalProgress(Progress):
    """One progress bar per run, which counts finished scenes and names the one in progress."""

    def __init__(self, console: Console | None = None) -> None:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("scenes"),
            TimeRemainingColumn(),
            TextColumn("[dim]{task.fields[now]}"),
        )
        super().__init__(*columns, console=console)
        self._task = self.add_task("", visible=False, now="")

    def begin(self, title: str, scenes: int, todo: int) -> None:
        """Start a new bar; scenes with a stored result count as done."""
        resumed = f"{scenes - todo} already stored" if todo < scenes else ""
        self._task = self.add_task(
            title or "run", total=scenes, completed=scenes - todo, now=resumed
        )

    def frames(self, scene: str, done: int, total: int) -> None:
        """Show the scene in progress and its frames."""
        self.update(self._task, now=f"{scene} {done}/{total}")

    def scene_ends(self, outcome: Outcome) -> None:
        """Advance the bar; the reasons of failures are printed at the end."""
        failed = f"{outcome.scene} failed" if outcome.error else ""
        self.update(self._task, advance=1, now=failed)


FILE_WIDTH = 140  # characters, of a table that is printed to a file or a pipe


def print_comparison(comparison: Comparison, console: Console | None = None) -> None:
    """Print the tables of a comparison and the paths of its files."""
    console = console or Console()
    if not console.is_terminal:
        console.width = FILE_WIDTH
    tables = {table.name: table for table in comparison_tables(comparison)}
    for name in ("differences", "sceneflow_rows"):  # long; they are among the stored tables
        tables.pop(name, None)
    runs = [run for run in comparison.runs if run.report.finished]
    titles = [run.title for run in runs]
    if len(runs) > 1:
        tables.pop("latency", None)  # long; it is among the stored tables
    for name, parts in (("velocity", VELOCITY_PARTS), ("flow", FLOW_PARTS)):
        if name in tables:
            tables[name] = compact(tables[name], titles, parts)
    for table in (*tables.values(), *leading_differences(comparison.differences)):
        console.print(rich_table(table))
    for line in _closing_lines(comparison, runs):
        console.print(line, highlight=False, soft_wrap=True)


def _closing_lines(comparison: Comparison, runs: Sequence[ScoredRun]) -> Iterator[str]:
    """Yield the latency of each run, the failures and the paths of the files."""
    for run in runs:
        if run.latency is not None:
            yield escape(f"latency {run.title}: {run.latency.summary}")
    for run in runs:
        for text in run.concerns:
            yield f"[yellow]warning[/] {escape(f'{run.title}: {text}')}"
    for name, reason in comparison.failed.items():
        yield f"[red]failed[/] {escape(f'{name}: {reason}')}"
    yield escape(f"figures: {comparison.out / 'scores.json'}")
    if runs:
        yield escape(f"tables:  {comparison.out / 'tables'}")


def rich_table(table: TextTable) -> Table:
    """Convert a table for the terminal; rows with the same first cell form a section."""
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

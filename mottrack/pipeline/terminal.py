"""What a run shows on the terminal: a progress bar while it works, tables at its end."""

from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from mottrack.eval.scores import Scores
from mottrack.pipeline.comparison import Comparison, ScoredRun, velocity_rows
from mottrack.pipeline.workers import Outcome


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
    runs = [run for run in comparison.runs if run.report.finished]
    if runs:
        console.print(_overall_table(runs))
        console.print(_velocity_table(runs))
        if any(run.scores.flow for run in runs):
            console.print(_flow_table(runs))
        console.print(_timing_table(runs))
    for name, reason in comparison.failed.items():
        console.print(f"[red]failed[/] {name}: {reason}", highlight=False, soft_wrap=True)
    console.print(f"figures: {comparison.out / 'scores.json'}", highlight=False, soft_wrap=True)


def _overall_table(runs: Iterable[ScoredRun]) -> Table:
    columns = (
        "AMOTA",
        "AMOTP m",
        "MOTA",
        "MOTP m",
        "recall",
        "misses",
        "false pos.",
        "switches",
        "IDF1",
        "HOTA",
    )
    table = Table("run", "class", *columns, title="Tracking, matched by centre distance")
    for run in runs:
        for label, scores in {"all": run.scores.overall, **run.scores.classes}.items():
            d = scores.as_dict()
            cells = (
                _number(d["amota"]),
                _number(d["amotp_m"]),
                _number(d["mota"]),
                _number(d["motp_m"]),
                _number(d["recall"]),
                str(d["misses"]),
                str(d["false_positives"]),
                str(d["id_switches"]),
                _number(d["idf1"]),
                _number(d["hota"]),
            )
            table.add_row(title(run) if label == "all" else "", label, *cells)
        table.add_section()
    return table


def _velocity_table(runs: list[ScoredRun]) -> Table:
    table = Table(
        "tracks", *_titles(runs), title="Track velocity error, m/s: mean | worst 5 % (rows)"
    )
    for row in velocity_rows(runs):
        cells = []
        for run in runs:
            error = run.velocity_error(row)
            cells.append(
                f"{_number(error.mean_mps)} | {_number(error.worst_mean_mps)} ({error.count})"
            )
        table.add_row(row, *cells)
    return table


def _flow_table(runs: list[ScoredRun]) -> Table:
    table = Table("cells", *_titles(runs), title="Flow error, m/s: RMSE | median | within 1 m/s")
    rows = dict.fromkeys(row for run in runs for row in run.scores.flow)
    for row in rows:
        table.add_row(row, *(_flow_cell(run.scores, row) for run in runs))
    return table


def _flow_cell(scores: Scores, row: str) -> str:
    if row not in scores.flow:
        return "-"
    error = scores.flow[row]
    if not error.cells:
        return "-"
    share = f"{100 * error.within_1_mps:.0f} %"
    return f"{_number(error.rmse_mps)} | {_number(error.median_mps)} | {share}"


def _timing_table(runs: list[ScoredRun]) -> Table:
    stages = dict.fromkeys(stage for run in runs for stage in run.stage_ms)
    table = Table("run", *stages, title="Wall time a key frame, ms")
    for run in runs:
        table.add_row(title(run), *(_number(run.stage_ms.get(s, 0.0), 1) for s in stages))
    return table


def title(run: ScoredRun) -> str:
    """What names a run in a table."""
    return run.experiment.variant or run.experiment.settings.name or run.experiment.flow.kind


def _titles(runs: Iterable[ScoredRun]) -> list[str]:
    return [title(run) for run in runs]


def _number(value: float, digits: int = 3) -> str:
    return "-" if value != value else f"{value:.{digits}f}"

"""Progress of training and calibration: a bar on a terminal, lines in a log file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from mottrack.flow.pillarflow.training.checkpoint import Progress as TrainingProgress

LINES = 100
"""Maximum number of lines in a log file: one per cent of the work each."""


class WorkBar:
    """Shows the progress; of several processes only the first one does."""

    def __init__(self, title: str, total: int) -> None:
        """Start with `total` steps; 0 until it is known."""
        self._hidden = int(os.environ.get("RANK", "0")) != 0
        self._console = Console()
        columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        now = TextColumn("{task.fields[now]}")
        silent = self._hidden or not self._console.is_terminal
        self._bar = Progress(*columns, now, console=self._console, disable=silent)
        self._task = self._bar.add_task(title, total=total or None, now="")
        self._title, self._written = title, -1

    def __enter__(self) -> WorkBar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def pairs(self, done: int, total: int) -> None:
        """Show the progress after each pair."""
        self._show(done, total, "")

    def training(self, progress: TrainingProgress) -> None:
        """Show the progress and the loss after each training step."""
        losses = [point["loss"] for point in progress.history[-3:] if "loss" in point]
        total = int(self._bar.tasks[0].total or 0)
        self._show(progress.step, total, f"loss {losses[-1]:.3f}" if losses else "")

    def _show(self, done: int, total: int, now: str) -> None:
        self._bar.update(self._task, completed=done, total=total, now=now)
        part = LINES * done // max(total, 1)
        if part > self._written and not (self._hidden or self._console.is_terminal):
            self._written = part
            self._console.print(f"{self._title} {done}/{total} {now}".rstrip(), highlight=False)

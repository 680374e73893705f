"""Progress of runs on the terminal: frame by frame with the time that is left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from mottrack.compiled import COMPILING_S
from mottrack.runs.tasks import Outcome, TaskProgress

LINE_EVERY_S = 5.0
"""Between two lines of a log file; a terminal's bar moves with every message."""
MINUTE_S = 60
HOUR_S = 60 * MINUTE_S
COMPILING = f"compiling, once, about {COMPILING_S:.0f} s of CPU time"


@dataclass
class WorkDone:
    """How far a job has got, in scenes of runs or shards; one in work counts by its steps."""

    tasks: int
    todo: int
    unit: str = "scenes"
    """What the tasks are, in words."""
    clock: Callable[[], float] = time.monotonic
    finished: int = 0
    failed: int = 0
    _shares: dict[tuple[str, Path], float] = field(default_factory=dict)
    _ended: set[tuple[str, Path]] = field(default_factory=set)
    _start: tuple[float, float] | None = None
    """Time and share at the first step: imports and compilation tell nothing of what is left."""

    def advances(self, progress: TaskProgress) -> None:
        """Note how far a task has got; on a cluster that may be told after its end."""
        for folder in progress.folders:
            if (progress.name, folder) not in self._ended:
                self._shares[progress.name, folder] = progress.done / max(progress.total, 1)
        if self._start is None:
            self._start = self.clock(), self.share

    def ends(self, outcome: Outcome) -> None:
        """Note a task that is finished or has failed."""
        self._shares.pop((outcome.name, outcome.folder), None)
        self._ended.add((outcome.name, outcome.folder))
        self.finished += 1
        self.failed += bool(outcome.error)

    @property
    def share(self) -> float:
        """Part of the work that is done, 0 to 1; without what was stored before."""
        return (self.finished + sum(self._shares.values())) / max(self.todo, 1)

    @property
    def left(self) -> str:
        """The time that is left, in words; empty until it can be told."""
        if self._start is None or self.share >= 1.0:
            return ""
        began_s, before = self._start
        if self.share <= before:
            return ""
        elapsed_s = self.clock() - began_s
        return f"{duration(elapsed_s * (1.0 - self.share) / (self.share - before))} left"

    @property
    def counted(self) -> str:
        """Finished tasks of all, those that were stored before included."""
        stored = self.tasks - self.todo
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{stored + self.finished}/{self.tasks} {self.unit}{failed}"


def duration(seconds: float) -> str:
    """Return a time as people say it: ``40 s``, ``3 min``, ``2 h 10 min``."""
    if seconds < MINUTE_S:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / MINUTE_S)
    if seconds < HOUR_S:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"


class TerminalProgress:
    """A bar on a terminal; in a file or a pipe a line every few seconds; or nothing if quiet."""

    def __init__(
        self,
        console: Console | None = None,
        *,
        unit: str = "scenes",
        quiet: bool = False,
        each_scene: bool = False,
    ) -> None:
        """Start without work.

        Args:
            console: where it is shown.
            unit: what the tasks are, in words.
            quiet: whether nothing is shown.
            each_scene: whether every scene that ends has a line of its own.
        """
        self._console = console or Console(file=sys.stdout)
        self._lines = not self._console.is_terminal and not quiet
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            TextColumn("{task.percentage:>3.0f} %"),
            TextColumn("{task.fields[now]}"),
        )
        self._bar = Progress(*columns, console=self._console, disable=quiet or self._lines)
        self._task = self._bar.add_task("", visible=False, now="")
        self._work, self._unit = WorkDone(0, 0), unit
        self._title, self._next_line_s = "", 0.0
        self._quiet, self._each_scene, self._compiled = quiet, each_scene, False

    def __enter__(self) -> TerminalProgress:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def begin(self, title: str, tasks: int, todo: int) -> None:
        """Start a new bar; tasks with a stored result are told, and count as done."""
        self._work, self._title = WorkDone(tasks, todo, self._unit), title or "run"
        resumed = f", {tasks - todo} already stored" if todo < tasks else ""
        self._task = self._bar.add_task(
            self._title, total=1.0, now=f"0/{todo} {self._unit}{resumed}"
        )
        self._say(f"{self._title}: {tasks} {self._unit}{resumed}")
        self._next_line_s = time.monotonic() + LINE_EVERY_S

    def advances(self, progress: TaskProgress) -> None:
        """Show the task in progress and its steps."""
        self._work.advances(progress)
        at = f"@{progress.node}" if progress.node else ""
        self._show(f"{progress.name}{at} {progress.done}/{progress.total}")

    def compiling(self) -> None:
        """Tell that a worker compiles, which happens once after the installation."""
        self._bar.update(self._task, now=COMPILING)
        if not self._compiled:  # every function is told, a log needs one line
            self._compiled = True
            self._say(COMPILING)

    def ends(self, outcome: Outcome) -> None:
        """Advance the bar; the reasons of failures are printed at the end."""
        self._work.ends(outcome)
        if self._each_scene and not self._quiet:
            name = f"{outcome.folder.name}/{outcome.name}"
            self._console.print(f"{name}: {outcome.error or 'done'}", highlight=False, markup=False)
        self._show(f"{outcome.name} failed" if outcome.error else "")

    def _show(self, now: str) -> None:
        parts = filter(None, (self._work.counted, self._work.left, now))
        self._bar.update(self._task, completed=self._work.share, now=", ".join(parts))
        if self._lines and (time.monotonic() >= self._next_line_s or self._work.share >= 1.0):
            self._next_line_s = time.monotonic() + LINE_EVERY_S
            parts = filter(None, (self._work.counted, self._work.left))
            self._say(f"{self._title}: {self._work.share:.0%}, {', '.join(parts)}")

    def _say(self, line: str) -> None:
        if self._lines:
            self._console.print(line, highlight=False, markup=False, soft_wrap=True)

"""Tasks in this process, one after the other: for programs and notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mottrack.compiled import compilation_told
from mottrack.runs.tasks import Job, Outcome, Progress, Task, attempt, seldom


@dataclass(frozen=True)
class Here:
    """An executor without worker processes: a program needs no ``__main__`` guard."""

    @property
    def slots(self) -> int:
        """One task at a time."""
        return 1

    def check(self, scenes: Mapping[Job, tuple[str, ...]]) -> None:
        """Accept: this process is the one that has planned the work."""

    def run(self, tasks: Sequence[Task], progress: Progress) -> list[Outcome]:
        """Run every task; one that raises fails alone."""
        outcomes: list[Outcome] = []
        with compilation_told(progress.compiling):
            for task in tasks:

                def tell(done: int, total: int, task: Task = task) -> None:
                    progress.advances(task.progress(done, total))

                found = attempt(task, seldom(tell))
                for outcome in found:
                    progress.ends(outcome)
                outcomes += found
        return outcomes

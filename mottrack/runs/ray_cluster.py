"""Tasks on a Ray cluster, of this machine alone or of many: the driver's side."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mottrack.core.storage import write_files, write_text
from mottrack.runs.node_check import Requirements, require_met
from mottrack.runs.ray_connection import LOCAL, connected, worker_environment
from mottrack.runs.ray_task import Board, Done, Needs, Place, run_task, unmet_here
from mottrack.runs.tasks import ATTEMPTS, DIED, Job, Outcome, Progress, Task

POLL_S = 0.5
"""Between two looks at the progress: as often as a person reads it."""
WAITING_PER_SLOT = 1
"""Tasks that wait on the cluster beside each that runs, so that no slot idles while the driver
writes a result; more would only hold memory and make an interruption slower."""
NODE_LOSSES = 5
"""Losses of its node that a task survives: they are not its fault, but must end some time."""
MEMORY_BYTES = 2**30
"""Asked for until the first task has told its peak: a worker that has imported and compiled
everything holds 0.6 to 0.8 GB."""
MEMORY_MARGIN = 1.2
"""Of the largest peak so far: scenes of one data set differ by about as much."""


@dataclass
class RayCluster:
    """An executor on Ray Core: one Ray task for each task, spread over the nodes."""

    address: str = LOCAL
    """``ray``: this machine alone; else what `ray.init` accepts: ``auto``, ``HOST:PORT`` on a
    machine of the cluster, ``ray://HOST:PORT`` from outside."""
    workers: int = 0
    """CPUs of a cluster of this machine alone; 0: all."""
    shared: bool = False
    """Whether tasks write their results, into a folder that every node sees; else the driver
    receives and writes them."""
    _requirements: Requirements = field(default_factory=lambda: Requirements(()), init=False)
    _checked: frozenset[str] = field(default=frozenset(), init=False)

    @property
    def slots(self) -> int:
        """Number of CPUs of the cluster."""
        return max(int(self._ray().cluster_resources().get("CPU", 1)), 1)

    def check(self, scenes: Mapping[Job, tuple[str, ...]]) -> None:
        """Compare code, weights, scenes and, if shared, the folder of results on every node.

        Raises:
            ConfigError: a node lacks something; it names the node.
            DataError: this machine lacks a file of weights.
        """
        ray = self._ray()
        token = None
        if self.shared:
            token = next(iter(scenes)).path.resolve() / f".token-{uuid.uuid4().hex}"
            write_text(token, "every node must see this file\n")
        self._requirements = Requirements.of(scenes, token)
        try:
            wanted = ray.put(self._requirements)
            nodes = [node["NodeID"] for node in ray.nodes() if node["Alive"]]
            ask = ray.remote(num_cpus=0, runtime_env=worker_environment())(unmet_here)
            on = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
            asked = {
                node: ask.options(scheduling_strategy=on(node, soft=False)).remote(wanted)
                for node in nodes
            }
            answers = _answers(ray, asked)
            require_met(list(answers.values()))
            self._checked = frozenset(answers)
        finally:
            if token is not None:
                token.unlink(missing_ok=True)

    def run(self, tasks: Sequence[Task], progress: Progress) -> list[Outcome]:
        """Run every task; one whose worker dies is tried again, and only it is affected.

        A lost node is no fault of its tasks: they are tried again elsewhere. An interruption
        cancels what runs.
        """
        ray = self._ray()
        needs = Needs(ray.put(self._requirements), self._checked)
        driver = _Driver(self, ray, progress, deque(tasks), needs)
        try:
            driver.run()
        finally:
            driver.cancel()
        return [driver.outcomes[folder, task.name] for task in tasks for folder in task.folders]

    def _ray(self) -> Any:
        """Return Ray, connected."""
        return connected(self.address, self.workers)


@dataclass
class _Driver:
    """The driver's side of the tasks of one run."""

    cluster: RayCluster
    ray: Any
    progress: Progress
    queue: deque[Task]
    needs: Needs
    outcomes: dict[tuple[Path, str], Outcome] = field(default_factory=dict)
    flying: dict[Any, Task] = field(default_factory=dict)
    lost: dict[tuple[Path, str], int] = field(default_factory=dict)
    peak_bytes: int = 0
    board: Any = None

    def run(self) -> None:
        """Work until no task is left."""
        here = self.ray.get_runtime_context().get_node_id()
        on = self.ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
        board = self.ray.remote(num_cpus=0)(Board)
        self.board = board.options(scheduling_strategy=on(here, soft=True)).remote()
        while self.queue or self.flying:
            while self.queue and len(self.flying) < (1 + WAITING_PER_SLOT) * self.cluster.slots:
                self._start(self.queue.popleft())
            ready, _ = self.ray.wait(list(self.flying), timeout=POLL_S)
            for ref in ready:
                self._end(ref, self.flying.pop(ref))
            self._show()

    def cancel(self) -> None:
        """Cancel what still runs."""
        for ref in self.flying:
            self.ray.cancel(ref, force=True)
        if self.board is not None:
            self.ray.kill(self.board)

    def _start(self, task: Task) -> None:
        remote = self.ray.remote(run_task).options(
            num_cpus=1,
            memory=self._memory(),
            max_retries=0,  # Ray's own would also count a lost node as the task's fault
            scheduling_strategy="SPREAD",
            runtime_env=worker_environment(),
        )
        # the working folder of a node is not the driver's
        shared = tuple(folder.resolve() for folder in task.folders) if self.cluster.shared else None
        self.flying[remote.remote(task, Place(self.needs, self.board, shared))] = task

    def _memory(self) -> int:
        """Return what a task needs: what one has needed, but no more than the largest node has."""
        nodes = [n["Resources"].get("memory", 0) for n in self.ray.nodes() if n["Alive"]]
        wanted = MEMORY_MARGIN * self.peak_bytes if self.peak_bytes else MEMORY_BYTES
        return int(min([wanted, max(nodes, default=wanted)]))

    def _end(self, ref: Any, task: Task) -> None:
        errors = self.ray.exceptions
        try:
            done: Done = self.ray.get(ref)
        except (errors.NodeDiedError, errors.LocalRayletDiedError, errors.ObjectLostError):
            self._node_lost(task)
        except (errors.WorkerCrashedError, errors.OutOfMemoryError) as error:
            self._died(task, type(error).__name__)
        except errors.RayError as error:  # not of the task: those are among the outcomes
            self._finish(task.failed(_last_line(error)))
        else:
            self.peak_bytes = max(self.peak_bytes, done.peak_bytes)
            stored = (o for o in done.outcomes if not o.error)
            for outcome, files in zip(stored, done.files, strict=False):
                write_files(outcome.folder, files)
            self._finish(done.outcomes)

    def _node_lost(self, task: Task) -> None:
        key = task.folders[0], task.name
        self.lost[key] = self.lost.get(key, 0) + 1
        if self.lost[key] > NODE_LOSSES:
            self._finish(task.failed(f"its node was lost {self.lost[key]} times"))
        else:
            self.queue.append(task)

    def _died(self, task: Task, cause: str) -> None:
        again = task.after_death()
        self.queue.extend(again)
        if not again:
            self._finish(task.failed(f"{DIED}: {ATTEMPTS} times, at last {cause}"))

    def _finish(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            self.outcomes[outcome.folder, outcome.name] = outcome
            self.progress.ends(outcome)

    def _show(self) -> None:
        try:
            told = self.ray.get(self.board.drain.remote(), timeout=POLL_S)
        except (self.ray.exceptions.RayError, TimeoutError):
            return  # the board is for the eye alone
        for progress in told:
            self.progress.advances(progress)


def _answers(ray: Any, asked: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Return what each node lacks; a node that is lost meanwhile is left out.

    Args:
        ray: connected.
        asked: node to its task.
    """
    found = {}
    for node, ref in asked.items():
        try:
            found[node] = ray.get(ref)
        except ray.exceptions.RayTaskError as error:
            found[node] = node[:6], f"can't be checked: {_last_line(error)}"
        except ray.exceptions.RayError:
            continue
    return found


def _last_line(error: Exception) -> str:
    """Return what has happened: Ray's errors carry the traceback of the other process."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__

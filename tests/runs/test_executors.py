"""The contract of executors, over both kinds of task: scenes, and shards of training examples."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mottrack.experiment.experiment import compose
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.runs.here import Here
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.ray_cluster import RayCluster
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import RunJob, SceneTask
from mottrack.runs.tasks import Executor, Job, Outcome, Task, TaskProgress
from mottrack.studies.example_sets import ExampleSet

FAULTY = ("a", "bug", "killed", "z")
SOUND = ("a", "b", "c", "z")  # in the same order, and toys do not depend on their names
FIRST_FAULT = 2  # the frame at which a scene with a fault fails


class Work(NamedTuple):
    """A job and its tasks."""

    job: Job
    tasks: list[Task]


def dataset(names: tuple[str, ...], flag: Path | None) -> dict[str, Any]:
    toys = {"kind": "toy_plugins:ToyDataset", "scenes": list(names), "frames": FIRST_FAULT + 1}
    return toys if flag is None else {**toys, "flag": str(flag)}


def scenes(names: tuple[str, ...], out: Path, flag: Path | None) -> Work:
    tracker = {"kind": "toy_plugins:EchoTracker"}
    tree = {"dataset": dataset(names, flag), "flow": "zero", "tracker": tracker}
    (experiment,) = compose(tree, ["score_flow=false"], Path("toys.yaml"))
    job = RunJob(experiment, RunFolder(out))
    return Work(job, [SceneTask(name, (job,)) for name in names])


def shards(names: tuple[str, ...], out: Path, flag: Path | None) -> Work:
    """One pair a shard: each scene has one before its fault and one with it."""
    counts = {"pairs": 6, "validation_pairs": 1, "per_shard": 1}
    examples = ExampleSet(ExamplesConfig(dataset=dataset(names, flag), **counts), out)
    return Work(examples, list(examples.tasks()))


class Notes:
    """Progress that is kept."""

    def __init__(self) -> None:
        self.told: list[TaskProgress] = []
        self.ended: list[Outcome] = []

    def begin(self, title: str, tasks: int, todo: int) -> None: ...

    def compiling(self) -> None: ...

    def advances(self, progress: TaskProgress) -> None:
        self.told.append(progress)

    def ends(self, outcome: Outcome) -> None:
        self.ended.append(outcome)


def stored(task: Task, out: Path) -> dict[str, bytes]:
    """Return what a task has stored, without the times that it took."""
    return {name: data for name, data in task.files(out).items() if not name.endswith(".json")}


@pytest.mark.parametrize(
    ("place", "make"),
    [
        ("local", scenes),
        ("local", shards),
        ("ray", scenes),
        ("ray", shards),
        ("ray shared", scenes),  # written by the tasks
    ],
)
def test_faults_are_named_and_the_rest_is_the_same(
    place: str,
    make: Callable[..., Work],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    """One task raises, one kills its worker every time, and one kills it once."""
    executor: Executor = LocalPool(2)
    if place != "local":
        request.getfixturevalue("cluster")
        executor = RayCluster(shared=place == "ray shared")
    monkeypatch.chdir(tmp_path)  # relative folders are the driver's, not a node's
    flag, out, undisturbed = tmp_path / "flag", Path("out"), Path("undisturbed")
    flag.touch()
    work, sound, notes = make(FAULTY, out, flag), make(SOUND, undisturbed, None), Notes()
    executor.check({work.job: work.job.scenes()})
    outcomes = executor.run(work.tasks, notes)
    assert not flag.exists()
    assert [(o.name, o.folder) for o in outcomes] == [(t.name, out) for t in work.tasks]
    assert {str(o) for o in notes.ended} == {str(o) for o in outcomes}
    failed = {outcome.name: outcome.error for outcome in outcomes if outcome.error}
    raised = [n for n, e in failed.items() if e.startswith("KeyError: 'bug' (toy_plugins.py:")]
    died = [name for name, error in failed.items() if "its process died" in error]
    assert raised
    assert died
    assert sorted(failed) == sorted(raised + died)
    finished = [task for task in work.tasks if task.name not in failed]
    assert len(finished) >= len(failed)
    steps = {told.name: (told.done, told.total) for told in notes.told}
    assert all(bool(told.node) == (place != "local") for told in notes.told)
    if place == "local":  # a busy cluster may tell it too late
        assert all(steps[task.name][0] == steps[task.name][1] > 0 for task in finished)
    assert all(not outcome.error for outcome in Here().run(sound.tasks, Notes()))
    assert all(stored(task, out) == stored(task, undisturbed) != {} for task in finished)
    assert not [file for file in out.rglob(".*") if file.suffix == ".part" or "token" in file.name]

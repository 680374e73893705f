"""An interrupted study resumes with identical results except for timings."""

from pathlib import Path

import pytest

from mottrack.experiment.experiment import compose
from mottrack.paper.plan import Study
from mottrack.paper.published import TABLE_III
from mottrack.paper.results import RUNTIME, Results, execute, run_studies
from mottrack.paper.tables import number_table
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.merge import merge_shards
from mottrack.runs.runner import Execution
from mottrack.runs.shard import Shard
from mottrack.runs.tasks import Outcome

TREE = {
    "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": ["a", "b"]},
    "flow": [{"kind": "zero"}, {"kind": "toy_plugins:ConstantFlow"}],
}


class Interrupted:
    """Progress that interrupts the run after a number of scenes."""

    def __init__(self, after: int = 99) -> None:
        self.left = after

    def begin(self, _title: str, _scenes: int, todo: int) -> None:
        self.todo = todo

    def advances(self, progress: object) -> None:
        pass

    def compiling(self) -> None:
        pass

    def ends(self, outcome: Outcome) -> None:
        assert not outcome.error
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def run(out: Path, workers: int, progress: Interrupted) -> Results:
    runs = tuple(compose(TREE, [], Path("toys.yaml")))
    study = Study("tracking", "world", "World", runs)
    return run_studies([study], out, execution=Execution(LocalPool(workers)), progress=progress)


def test_interrupted_and_resumed_with_other_workers_is_the_same(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", 2, Interrupted())
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "parts", 1, Interrupted(after=2))
    progress = Interrupted()
    parts = run(tmp_path / "parts", 1, progress)
    assert progress.todo == 2
    stored = sorted(
        path.relative_to(tmp_path / "whole") for path in tmp_path.glob("whole/**/*.npz")
    )
    assert len(stored) > 4  # four results, and snapshots
    for path in stored:
        assert (tmp_path / "whole" / path).read_bytes() == (tmp_path / "parts" / path).read_bytes()
    tables = [number_table(TABLE_III, results.studies[0]).texts() for results in (whole, parts)]
    assert tables[0] == tables[1]
    assert not whole.failed
    assert not parts.failed


def test_merged_shards_of_a_paper_leave_nothing_to_run(tmp_path: Path) -> None:
    runs = tuple(compose(TREE, [], Path("toys.yaml")))
    studies = [Study(name, "world", "World", runs) for name in ("tracking", RUNTIME)]
    for k in (2, 1):
        shard = Execution(LocalPool(1), Shard(k, 2))
        execute(studies, tmp_path / str(k) / "runs", execution=shard, progress=Interrupted())
    merged = merge_shards([tmp_path / "2", tmp_path / "1"], tmp_path / "all")
    assert len(merged.reports) == 4
    progress = Interrupted()
    found = run_studies(
        studies, tmp_path / "all" / "runs", execution=Execution(LocalPool(1)), progress=progress
    )
    assert progress.todo == 0
    assert not found.failed
    assert found.machines  # of every shard; the same text, with the load at the end, once
    assert all(study.sampling.scenes == ("a", "b") for study in found.studies)

"""The same run on a Ray cluster of three nodes on this machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mottrack.core import ConfigError
from mottrack.experiment.experiment import Experiment, compose
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.ray_cluster import RayCluster
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, RunJob, RunReport, run_jobs

ray = pytest.importorskip("ray", reason="needs the extra ray")


def toys(*scenes: str, flag: Path | None = None) -> list[Experiment]:
    tree = {
        "dataset": {
            "kind": "toy_plugins:ToyDataset",
            "scenes": list(scenes),
            "flag": None if flag is None else str(flag),
        },
        "flow": ["zero", "toy_plugins:ConstantFlow"],
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    return compose(tree, [], Path("toys.yaml"))


def run(experiments: list[Experiment], out: Path, where: Any, progress: Any) -> list[RunReport]:
    jobs = [RunJob(e, RunFolder(out / e.flow.kind[-4:])) for e in experiments]
    return run_jobs(jobs, execution=Execution(where), progress=progress)


def files_of(folder: Path) -> dict[str, bytes]:
    found = [*folder.rglob("*.npz"), *folder.rglob("run.json"), *folder.rglob("config.yaml")]
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(found)}


def test_the_results_are_those_of_local_processes_whatever_dies(
    cluster: Any, tmp_path: Path, progress: Any
) -> None:
    """One worker is killed, one scene raises, one kills its worker every time, a node dies."""

    class Watch(type(progress)):
        def __init__(self) -> None:
            self.ended = 0

        def ends(self, outcome: object) -> None:
            self.ended += 1
            if self.ended == 4:
                cluster.remove_node(cluster.spare.pop(), allow_graceful=False)

    names = [f"s{k}" for k in range(10)]
    flag = tmp_path / "flag"
    flag.touch()
    experiments = toys(*names[:5], "poison", "killed", *names[5:], flag=flag)
    local = run(toys(*names), tmp_path / "local", LocalPool(2), progress)
    watch = Watch()
    reports = run(experiments, tmp_path / "ray", RayCluster(), watch)
    assert len(cluster.spare) == 1  # the node was lost while scenes ran
    assert not flag.exists()
    assert all(not report.failed for report in local)
    for report in reports:
        assert set(report.failed) == {"poison", "killed"}
        assert "point 7 is nan" in report.failed["poison"]
        assert "its process died" in report.failed["killed"]
        assert set(report.finished) == set(names)
    for run_name in ("zero", "Flow"):
        theirs = files_of(tmp_path / "ray" / run_name / "scenes")
        mine = files_of(tmp_path / "local" / run_name / "scenes")
        results = [name for name in mine if name.count(".") == 1]
        assert len(results) == len(names)
        assert {name: theirs[name] for name in results} == {name: mine[name] for name in results}


@pytest.mark.usefixtures("cluster")
def test_a_node_with_other_scenes_is_refused_by_name(tmp_path: Path) -> None:
    (first, _) = toys("a")
    job, there = RunJob(first, RunFolder(tmp_path)), RayCluster()
    with pytest.raises(ConfigError, match=r"node \S+/\w{6} \(and \d more nodes\): 1 scenes, exp"):
        there.check({job: ("a", "b")})
    other = replace(there, shared=True)
    other.check({job: ("a",)})


@pytest.mark.parametrize("address", ["127.0.0.1:9", "ray://127.0.0.1:9", "nowhere:x"])
def test_a_cluster_that_does_not_answer_is_told_at_once(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    with pytest.raises(ConfigError, match=f"no Ray cluster at {address}"):
        _ = RayCluster(address).slots


def test_an_interruption_cancels_what_runs_and_the_run_resumes(
    cluster: Any, tmp_path: Path, progress: Any
) -> None:
    class Interrupts(type(progress)):
        def ends(self, _outcome: object) -> None:
            raise KeyboardInterrupt

    assert cluster.address
    names = ("a", "b", "c", "d", "e", "f")
    with pytest.raises(KeyboardInterrupt):
        run(toys(*names), tmp_path / "ray", RayCluster(), Interrupts())
    reports = run(toys(*names), tmp_path / "ray", RayCluster(), progress)
    assert all(report.finished == names for report in reports)
    assert any(report.resumed for report in reports)
    run(toys(*names), tmp_path / "local", LocalPool(2), progress)
    assert files_of(tmp_path / "ray") == files_of(tmp_path / "local")

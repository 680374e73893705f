"""Shards and their merge, what runs share, the cache between runs, and the lock of a folder."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from mottrack.core import ConfigError
from mottrack.experiment.experiment import Experiment, compose, load_experiments
from mottrack.pipeline.flow_cache import FlowCache
from mottrack.runs.comparison import comparison_jobs, run_comparison, score_runs, stored_run
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.lock import only_driver
from mottrack.runs.merge import Merged, merge_shards
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, RunReport, SceneTask, run_jobs, scene_names
from mottrack.runs.shard import Shard

LOCAL = LocalPool(2)
NAMES = ("a", "b", "poison", "c", "d")


def toys() -> list[Experiment]:
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": list(NAMES)},
        "flow": ["zero", "toy_plugins:ConstantFlow"],
        "tracker": {"kind": "toy_plugins:EchoTracker"},
        "snapshots": {"scenes": 2},
    }
    return compose(tree, [], Path("toys.yaml"))


def world(*overrides: str) -> list[Experiment]:
    """Six runs of three flows, one of which filters over time, on short scenes."""
    short = ["dataset.scenes=2", "dataset.duration_s=1", "flow=zero,ground_truth,dogma"]
    return load_experiments("demo", [*short, "tracker=kalman,fixed_lag", *overrides])


def run(
    experiments: list[Experiment], out: Path, execution: Execution, progress: Any
) -> list[RunReport]:
    return run_jobs(comparison_jobs(experiments, out), execution=execution, progress=progress)


def files_of(folder: Path) -> dict[str, bytes]:
    found = [*folder.rglob("*.npz"), *folder.rglob("run.json"), *folder.rglob("config.yaml")]
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(found)}


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory, progress: Any) -> Path:
    """The unsharded comparison in ``all``, its shards in ``1`` to ``5``, run in another order."""
    out = tmp_path_factory.mktemp("shards")
    run_comparison(toys(), out / "all", execution=Execution(LOCAL), progress=progress)
    for k in (3, 1, 5, 2, 4):
        run(toys(), out / str(k), Execution(LOCAL, Shard(k, 5)), progress)
    return out


def merged(shards: Path, out: Path, *names: str) -> Merged:
    return merge_shards([shards / name for name in names], out)


def test_merged_shards_are_the_unsharded_run(shards: Path, tmp_path: Path) -> None:
    shutil.copytree(shards / "2", tmp_path / "again")
    found = merge_shards([*(shards / k for k in "35142"), tmp_path / "again"], tmp_path / "m")
    assert [text.partition(" ")[0] for text in found.repeated] == ["2/5", "2/5"]
    assert files_of(tmp_path / "m") == files_of(shards / "all")
    runs = [stored_run(RunFolder(tmp_path / "m" / p), p.name, r) for p, r in found.reports.items()]
    score_runs(tuple(runs), tmp_path / "m")
    mine, theirs = (
        json.loads((folder / "scores.json").read_text())
        for folder in (tmp_path / "m", shards / "all")
    )
    for figures in (mine, theirs):
        for part in figures["runs"]:
            del part["latency"]
        assert [part["failed"].keys() for part in figures["runs"]] == [{"poison"}] * 2
    assert mine == theirs


def test_missing_interrupted_and_foreign_shards_are_told(
    shards: Path, tmp_path: Path, progress: Any
) -> None:
    with pytest.raises(ConfigError, match="shard 2/5, 4/5 missing among 3 folders"):
        merged(shards, tmp_path / "m", "1", "3", "5")
    shutil.copytree(shards / "2", tmp_path / "2")
    next(tmp_path.glob("2/zero/shards.json")).unlink()
    with pytest.raises(ConfigError, match="2/zero holds no finished shard"):
        merge_shards([*(shards / k for k in "1345"), tmp_path / "2"], tmp_path / "m")
    run(toys(), tmp_path / "half", Execution(LOCAL, Shard(2, 2)), progress)
    with pytest.raises(ConfigError, match=r"is shard 2/2, .* is shard 1/5: expected the same num"):
        merge_shards([shards / "1", tmp_path / "half"], tmp_path / "m")
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize("text", ["0/3", "4/3", "x/3", "3", "1/0"])
def test_a_shard_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="expected I/N"):
        Shard.parse(text)


def test_runs_that_share_compute_once_and_store_the_same_bytes(
    tmp_path: Path, progress: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(world(), tmp_path / "alone", Execution(LOCAL, share=False), progress)
    run(world(), tmp_path / "shared", Execution(LocalPool(1)), progress)
    assert len(files_of(tmp_path / "alone")) == 6 * (2 + 2 * 4)  # of a scene four
    assert files_of(tmp_path / "alone") == files_of(tmp_path / "shared")
    pairs: list[object] = []
    (job, *_) = jobs = comparison_jobs(world()[-2:], tmp_path / "counted")
    flow = job.experiment.flow.cls
    estimate = flow.estimate
    monkeypatch.setattr(flow, "estimate", lambda *a: (pairs.append(a), estimate(*a))[1])
    scene = scene_names(job.experiment)[0]
    SceneTask(scene, tuple(jobs)).work(lambda *_: None)
    assert 0 < len(pairs) < len(job.experiment.dataset.make().scene(scene))
    times = [
        json.loads((tmp_path / "shared" / name / "scenes" / file).read_text())["flow"]
        for name in ("dogma+kalman", "dogma+fixed_lag")
        for file in [next((tmp_path / "shared" / name).glob("scenes/*.timings.json")).name]
    ]
    assert times[0] == pytest.approx(times[1], abs=1e-3)  # the second run is charged as well
    assert max(times[1]) > 1e-3


def test_a_failing_run_leaves_those_it_shares_with(tmp_path: Path, progress: Any) -> None:
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset"},
        "flow": {"kind": "toy_plugins:ConstantFlow"},
        "tracker": ["toy_plugins:EchoTracker", "toy_plugins:FailingTracker"],
    }
    experiments = compose(tree, [], Path("toys.yaml"))
    good, bad = run(experiments, tmp_path, Execution(LocalPool(1)), progress)
    assert good.finished == ("a", "b")
    assert set(bad.failed) == {"a", "b"}
    assert "ZeroDivisionError" in bad.failed["a"]


def test_cached_flow_gives_the_same_bytes_and_is_not_measured_again(
    tmp_path: Path, progress: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = FlowCache(tmp_path / "cache", 10**9)
    runs = [e for e in world() if e.tracker.kind == "kalman" and e.flow.kind != "zero"]
    for name, kept in (("plain", None), ("stores", cache)):
        run(runs, tmp_path / name, Execution(LOCAL, cache=kept), progress)
    assert len(cache.entries) == 4
    assert files_of(tmp_path / "plain") == files_of(tmp_path / "stores")
    (*_, job) = comparison_jobs(runs, tmp_path / "reads")
    assert job.experiment.flow.kind == "dogma"
    job.folder.reserve(job.experiment)
    monkeypatch.setattr(job.experiment.flow.cls, "estimate", lambda *_: pytest.fail("measured"))
    for scene in scene_names(job.experiment):
        (outcome,) = SceneTask(scene, (job,), cache).work(lambda *_: None)
        assert not outcome.error
    assert files_of(tmp_path / "plain" / "dogma+kalman") == files_of(job.folder.path)


def test_the_cache_answers_only_for_the_same_data_and_undamaged(
    tmp_path: Path, progress: Any
) -> None:
    cache = FlowCache(tmp_path / "cache", 10**9)
    (first,) = [e for e in world("dataset.scenes=1") if e.variant == "dogma+kalman"]
    run([first], tmp_path / "first", Execution(LOCAL, cache=cache), progress)
    (entry,) = cache.entries
    whole = entry.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:500] + b"\x00" * 9 + whole[509:]):
        entry.write_bytes(damaged)
        again = tmp_path / f"again{len(damaged)}"
        run([first], again, Execution(LOCAL, cache=cache), progress)
        assert files_of(again) == files_of(tmp_path / "first")
        assert cache.entries == [entry]
    (other,) = [e for e in world("dataset.scenes=1", "pair_s=0.2") if e.variant == "dogma+kalman"]
    run([other], tmp_path / "other", Execution(LOCAL, cache=cache), progress)
    assert len(cache.entries) == 2
    os.utime(entry, (1, 1))
    FlowCache(cache.folder, cache.size_bytes - 1).trim()
    assert entry not in cache.entries
    assert len(cache.entries) == 1


def test_a_second_driver_is_refused(tmp_path: Path, progress: Any) -> None:
    with only_driver(tmp_path), pytest.raises(ConfigError, match=r"in use by process \d+ on "):
        run(toys()[:1], tmp_path, Execution(LOCAL), progress)

import json
import multiprocessing
import shutil
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError, DataError
from mottrack.core.snapshot import load_snapshots
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import write_synthetic
from mottrack.experiment.experiment import Experiment, compose
from mottrack.flow.pillarflow.source import SHIPPED
from mottrack.pipeline.scene_run import run_scene
from mottrack.runs.comparison import load_comparison, run_comparison
from mottrack.runs.comparison_tables import comparison_tables
from mottrack.runs.local_pool import LocalPool, _Pool, _Worker
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, SceneTask, run_experiment
from mottrack.runs.terminal import closing_text, comparison_text
from tests.datasets.makers import embedded_scenes, write_own_log

HERE = Path("experiment.yaml")


def toy_experiment(*overrides: str, **dataset: object) -> Experiment:
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset", **dataset},
        "flow": {"kind": "toy_plugins:ConstantFlow"},
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    return compose(tree, overrides, HERE)[0]


def files_of(folder: Path) -> dict[str, bytes]:
    return {f.name: f.read_bytes() for f in sorted(folder.glob("scenes/*.npz"))}


def test_plug_ins_run_from_sweep_to_score() -> None:
    experiment = toy_experiment()
    run = run_scene(experiment, experiment.dataset.make().scene("a"))
    tracks = run.result.tracks
    assert len(run.result.frames) == 8
    later = tracks.frame > 0  # the first frame has no earlier sweep, hence no velocity
    np.testing.assert_allclose(tracks.velocity_mps[later], np.tile([10.0, 0.0], (14, 1)))
    assert (tracks.velocity_mps[~later] == 0).all()
    flow = run.result.flow
    assert len(flow) > 100
    dynamic = flow.dynamic
    np.testing.assert_allclose(flow.truth_mps[dynamic], flow.estimate_mps[dynamic], atol=1e-4)
    assert set(run.result.timings_s) >= {"read", "flow", "velocity", "tracker"}
    assert [shot.frame for shot in run.snapshots] == list(range(8))


def test_sweeps_are_not_read_where_no_part_needs_them(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = toy_experiment("flow=zero", "score_flow=false")
    scene = experiment.dataset.make().scene("a")
    monkeypatch.setattr(type(scene), "sweep", lambda *_: pytest.fail("sweep was read"))
    assert len(run_scene(experiment, scene).result.tracks) == 16


def test_results_do_not_depend_on_the_number_of_workers(tmp_path: Path, progress) -> None:
    experiment = toy_experiment(scenes=("a", "b", "c"))
    for workers in (1, 3):
        run_experiment(
            experiment,
            RunFolder(tmp_path / str(workers)),
            execution=Execution(LocalPool(workers)),
            progress=progress,
        )
    assert files_of(tmp_path / "1") == files_of(tmp_path / "3")
    assert len(files_of(tmp_path / "1")) == 12  # result, snapshots, objects, scene flow
    assert len(load_snapshots(tmp_path / "1" / "scenes" / "a.snapshots.npz")) == 8


def test_a_worker_that_dies_after_its_result_is_replaced(progress) -> None:
    class Dead:
        def join(self) -> None: ...

    task = SceneTask("a", ())
    for served in (True, False):
        hired = []
        pool = _Pool(progress, deque([task]))
        pool.start_worker = lambda hired=hired: hired.append(True)
        ours, theirs = multiprocessing.Pipe()
        theirs.close()
        worker = _Worker(Dead(), ours, served=served)
        pool._give_task(worker)
        # the scene is not to blame, unless it is the first that was sent
        assert [t.deaths for t in pool.queue] == ([0] if served else [1] * len(task.jobs))
        assert hired == ([True] if served else [])
        assert not pool.busy


def test_an_interrupted_run_is_resumed_with_the_same_bytes(tmp_path: Path, progress) -> None:
    experiment = toy_experiment(scenes=("a", "b", "c"))
    whole, broken = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "broken")
    run_experiment(experiment, whole, execution=Execution(LocalPool(2)), progress=progress)
    run_experiment(experiment, broken, execution=Execution(LocalPool(2)), progress=progress)
    broken.scene_file("b").unlink()
    damaged = bytearray(broken.scene_file("c").read_bytes())
    damaged[len(damaged) // 2] ^= 1
    broken.scene_file("c").write_bytes(bytes(damaged))
    report = run_experiment(
        experiment, broken, execution=Execution(LocalPool(2)), progress=progress
    )
    assert (report.resumed, progress.todo) == (1, 2)
    assert files_of(tmp_path / "whole") == files_of(tmp_path / "broken")


def test_a_folder_of_another_configuration_is_refused(tmp_path: Path, progress) -> None:
    run_experiment(
        toy_experiment(scenes=("a",)),
        RunFolder(tmp_path),
        execution=Execution(LocalPool(1)),
        progress=progress,
    )
    other = toy_experiment("pair_s=0.2", scenes=("a",))
    with pytest.raises(ConfigError, match="results of another configuration"):
        run_experiment(
            other, RunFolder(tmp_path), execution=Execution(LocalPool(1)), progress=progress
        )


def test_scores_json_holds_every_run_and_the_configuration_lies_beside(
    tmp_path: Path, progress
) -> None:
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset"},
        "flow": ["zero", "ground_truth"],
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    comparison = run_comparison(
        compose(tree, [], HERE), tmp_path, execution=Execution(LocalPool(2)), progress=progress
    )
    stored = json.loads((tmp_path / "scores.json").read_text())["runs"]
    assert [(r["variant"], r["flow"]) for r in stored] == [("zero",) * 2, ("ground_truth",) * 2]
    assert stored[0]["metrics"]["classes"]["car"]["mota"] == 1.0
    errors = [r["metrics"]["velocity_error"]["fast [3, inf) m/s"]["mean_mps"] for r in stored]
    assert errors[0] == pytest.approx(10.0)
    assert errors[1] < 2.0  # the first frame of each scene has no velocity yet
    assert comparison.runs[0].experiment.hash in (tmp_path / "zero" / "config.yaml").read_text()


def test_results_of_other_code_or_other_weights_are_refused(tmp_path: Path) -> None:
    """The same guard stands before run, compare and paper: all of them reserve their folders."""
    weights = tmp_path / "mine.safetensors"
    weights.write_bytes((SHIPPED / "small.safetensors").read_bytes())
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": ["a"]},
        "flow": {"kind": "pillarflow", "weights": str(weights)},
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    (experiment,) = compose(tree, [], HERE)
    folder = RunFolder(tmp_path / "run")
    folder.reserve(experiment)
    folder.reserve(experiment)
    weights.write_bytes((SHIPPED / "base.safetensors").read_bytes())
    with pytest.raises(ConfigError, match=r"results of another weights mine\.safetensors \(run"):
        folder.reserve(experiment)
    weights.unlink()
    with pytest.raises(DataError, match=r"mine\.safetensors: file is No such file"):
        folder.reserve(experiment)
    identity = json.loads(folder.identity_file.read_text())
    folder.identity_file.write_text(json.dumps(identity | {"code": "of yesterday"}))
    weights.write_bytes((SHIPPED / "small.safetensors").read_bytes())
    with pytest.raises(ConfigError, match="results of another code"):
        folder.reserve(experiment)


def test_partial_files_of_a_killed_writer_are_removed(tmp_path: Path, progress) -> None:
    left = tmp_path / "scenes" / ".a.npz.x7d9.part"
    left.parent.mkdir()
    left.write_bytes(b"half")
    run_experiment(
        toy_experiment(scenes=("a",)),
        RunFolder(tmp_path),
        execution=Execution(LocalPool(1)),
        progress=progress,
    )
    assert not list(tmp_path.rglob("*.part"))
    assert not left.exists()


def test_a_run_reports_its_latency(tmp_path: Path, progress) -> None:
    experiment = toy_experiment(scenes=("a", "b"))
    comparison = run_comparison(
        [experiment], tmp_path, execution=Execution(LocalPool(1)), progress=progress
    )
    report = comparison.runs[0].latency
    assert report is not None
    assert report.budget_ms == pytest.approx(100.0)  # the toy's sweeps are 0.1 s apart
    assert {"flow", "objects", "velocity", "tracker", "total"} <= set(report.stages)
    assert 10 <= report.steps <= 14  # of 2 x 8 steps those in which no stage ran first
    table = {t.name: t for t in comparison_tables(comparison)}["latency"]
    assert [row[1] for row in table.rows][-1] == "total"
    assert f"/{report.steps}" in "\n".join(comparison_text(comparison, 80))
    assert f"of {report.steps} steps over it" in "\n".join(
        comparison_text(comparison, 80, full=True)
    )
    assert load_comparison(tmp_path).runs[0].latency == report


def test_a_scene_without_detections_names_the_file_that_should_hold_them(
    tmp_path: Path,
) -> None:
    world = SyntheticConfig(scenes=1, seed=3, duration_s=0.2)
    write_synthetic(tmp_path, "kitti", world)
    shutil.rmtree(tmp_path / "detections")
    tree = {"dataset": {"kind": "kitti", "root": str(tmp_path)}, "score_flow": False}
    (experiment,) = compose(tree, [], HERE)
    scene = experiment.dataset.make().scene("0000")
    words = r"detections/pointrcnn/{Pedestrian,Car,Cyclist}/0000.txt: detections of 0000 is absent"
    with pytest.raises(DataError, match=words.replace("{", r"\{").replace("}", r"\}")):
        run_scene(experiment, scene)


def test_what_a_reader_left_out_is_told_again_by_the_run(tmp_path: Path, progress) -> None:
    """Also where boxes alone are read of a stored result."""
    log = tmp_path / "logs" / "monday"
    write_own_log(log, embedded_scenes()[0])
    sorted(log.glob("sweeps/*"))[1].unlink()
    tree = {"dataset": {"kind": "folder", "root": str(log.parent)}, "score_flow": False}
    comparison = run_comparison(
        compose(tree | {"objects": "clusters", "flow": "zero"}, [], HERE),
        tmp_path / "out",
        execution=Execution(LocalPool(1)),
        progress=progress,
    )
    (run,) = comparison.runs
    assert not comparison.failed
    assert any("sweeps that are missing or empty: 1 in 1 scene" in text for text in run.concerns)
    assert "sweeps that are missing or empty" in "\n".join(closing_text(comparison))


def test_a_flow_that_contradicts_the_tracks_is_told_once_by_its_name() -> None:
    """Two cars at 10 m/s; the source reads 10, then 4 m/s, and states 0.1 m/s both times."""
    tree = {"dataset": {"kind": "toy_plugins:ToyDataset", "scenes": ["a"], "frames": 30}}
    tree |= {"tracker": "kalman", "score_flow": False}
    for speed_mps, told in ((10.0, 0), (4.0, 1)):
        flow = {"kind": "toy_plugins:ConstantFlow", "speed_mps": speed_mps}
        (experiment,) = compose(tree | {"flow": flow}, [], HERE)
        run = run_scene(experiment, experiment.dataset.make().scene("a"))
        texts = [str(concern) for concern in run.result.concerns]
        found = [text for text in texts if text.startswith("toy_plugins:ConstantFlow flow: ")]
        assert len(found) == told, texts

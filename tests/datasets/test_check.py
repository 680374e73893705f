"""`mottrack check`, `synth` and `submit` as commands."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import DataError, FrameTable, SceneResult, TrackTable, TruthTable
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.run_folder import RunFolder


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.parametrize("name", ["kitti", "nuscenes", "argoverse2"])
def test_a_whole_data_set_has_no_fault(name, written_roots):
    """The kind follows from the layout alone."""
    result = run("check", written_roots[name], "--workers", 1)
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f"{name}: 1 scenes")
    assert "no fault found" in result.output


def test_faults_are_counted_by_kind(written_roots, tmp_path):
    root = tmp_path / "kitti"
    shutil.copytree(written_roots["kitti"], root)
    sweeps = root / "training/velodyne/0000"
    (sweeps / "000001.bin").unlink()
    (sweeps / "000002.bin").write_bytes((sweeps / "000002.bin").read_bytes()[:-5])
    values = np.fromfile(sweeps / "000003.bin", "<f4")
    values[100] = np.nan
    values.tofile(sweeps / "000003.bin")
    poses = root / "training/poses/0000.txt"
    rows = poses.read_text().splitlines()
    numbers = rows[5].split()
    numbers[3] = "500.0"
    rows[5] = " ".join(numbers)
    poses.write_text("\n".join(rows))
    result = run("check", root, "--workers", 1)
    assert result.exit_code == 3
    for kind in ("missing: 1 in 1", "truncated: 1 in 1", "non-finite: 1 in 1", "jump:"):
        assert kind in result.output, result.output
    assert "000002.bin: size in bytes is" in result.output


def test_unknown_folder_and_settings(written_roots, tmp_path):
    with pytest.raises(Exception, match="looks like no known data set"):
        raise run("check", tmp_path).exception
    with pytest.raises(Exception, match="velodyne_rot is not a known key"):
        raise run("check", written_roots["kitti"], "velodyne_rot=x").exception


def test_synth_writes_a_new_folder_only(tmp_path):
    out = tmp_path / "new"
    command = ("synth", out, "--scenes", 1, "--format", "kitti", "--duration", 0.3, "--seed", 4)
    result = run(*command)
    assert result.exit_code == 0, result.output
    assert "1 scenes in kitti format" in result.output
    with pytest.raises(Exception, match="is not empty"):
        raise run(*command).exception
    with pytest.raises(Exception, match=r"unknown format 'kiti'.*did you mean 'kitti'"):
        raise run("synth", tmp_path / "other", "--format", "kiti").exception


def test_submit_writes_every_sample_of_a_run(written_roots, tmp_path):
    """At most 500 boxes a sample, those of the highest score; a missing scene is an error."""
    dataset = NuScenes(NuScenesConfig(root=written_roots["nuscenes"], rate_hz=2))
    scene = dataset.scene(dataset.scene_names[0])
    frames = [scene.frame(i) for i in range(len(scene))]
    tracks = crowd(600)
    run_folder = tmp_path / "run"
    dataset_of_run = f"dataset={{kind: nuscenes, root: {written_roots['nuscenes']}, split: val}}"
    RunFolder(run_folder).reserve(load_experiments("demo", [dataset_of_run, "flow=zero"])[0])
    result = SceneResult(scene.name, FrameTable.of(frames), TruthTable.empty(), tracks)
    result.save(run_folder / "scenes" / f"{scene.name}.npz")
    out = tmp_path / "submission.json"
    command = ("submit", run_folder, "--out", out, "--root", written_roots["nuscenes"])
    assert run(*command).exit_code == 0
    content = json.loads(out.read_text())
    assert list(content["results"]) == [frame.token for frame in frames]
    boxes = content["results"][frames[0].token]
    assert len(boxes) == 500
    assert min(box["tracking_score"] for box in boxes) >= 0.1
    assert boxes[0]["size"] == [2.0, 4.0, 1.5]
    assert boxes[0]["tracking_id"].startswith(f"{scene.name}_")
    shorter = SceneResult(scene.name, FrameTable.of(frames[:-1]), TruthTable.empty(), tracks)
    shorter.save(run_folder / "scenes" / f"{scene.name}.npz")
    with pytest.raises(DataError, match="split val: 1 of 3 are missing"):
        raise run(*command).exception


def crowd(count):
    return TrackTable(
        frame=np.zeros(count, dtype=np.int64),
        id=np.arange(count),
        label=np.full(count, "car"),
        centre_m=np.zeros((count, 3)),
        size_m=np.tile([4.0, 2.0, 1.5], (count, 1)),
        yaw_rad=np.zeros(count),
        velocity_mps=np.zeros((count, 2)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=np.linspace(0.0, 1.0, count),
        observed=np.ones(count, dtype=bool),
        hull_corners=np.zeros(count, dtype=np.int64),
    )

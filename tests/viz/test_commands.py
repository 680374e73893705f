"""`mottrack view`, `animate` and `animate-map`, from the command line to the file."""

from __future__ import annotations

import pytest
import typer
from PIL import Image
from typer.testing import CliRunner

from mottrack.cli import view
from mottrack.core.errors import ConfigError, MottrackError, ResultError
from mottrack.core.snapshot import save_snapshots
from mottrack.runs.run_folder import RunFolder, pick_scene, stored_scenes


@pytest.fixture
def run(result, snapshot, tmp_path):
    """A finished run of one scene."""
    folder = RunFolder(tmp_path / "run")
    folder.path.mkdir()
    folder.config_file.write_text("name: test\n")
    save_snapshots(folder.snapshots_file("scene"), [snapshot])
    result.save(folder.scene_file("scene"))
    return folder.path


def call(*arguments):
    app = typer.Typer()
    view.register(app)
    found = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(found.exception, MottrackError):
        raise found.exception
    assert found.exit_code == 0, found.output
    return found.output


def test_a_run_is_animated(run, tmp_path):
    out = tmp_path / "scene.gif"
    assert "3 pictures" in call("animate", run, "--scene", "scene", "--out", out, "--speed", "2")
    with Image.open(out) as image:
        assert image.n_frames == 3
        assert image.info["duration"] == 250


def test_a_run_is_recorded_scene_by_scene(run, result, tmp_path):
    pytest.importorskip("rerun")
    call("view", run, "--save", tmp_path / "one.rrd")
    assert (tmp_path / "one.rrd").stat().st_size > 1_000
    result.save(run / "scenes" / "second.npz")
    assert stored_scenes(run) == ("scene", "second")
    call("view", run, "--save", tmp_path / "many.rrd")
    assert {path.name for path in tmp_path.glob("many*")} == {"many-scene.rrd", "many-second.rrd"}


def test_what_is_no_run_is_refused(run, tmp_path):
    with pytest.raises(ConfigError, match="holds several runs; name one of: run"):
        stored_scenes(tmp_path)
    with pytest.raises(ResultError, match=r"no config\.yaml"):
        stored_scenes(run / "scenes")
    with pytest.raises(ConfigError, match=r"unknown scene .*valid: scene"):
        pick_scene(run, "scenery")
    (run / "scenes" / "scene.npz").unlink()
    with pytest.raises(ResultError, match="finished scenes"):
        stored_scenes(run)


SHORT = ("dataset.scenes=1", "dataset.duration_s=0.4")
FEW = ("flow.filter.particles=2000", "flow.filter.births=200", "flow.threads=1", "grid.cell_m=1.0")


def test_a_map_is_animated_from_a_configuration(tmp_path):
    out = tmp_path / "map.gif"
    assert "3 pictures" in call("animate-map", "demo", *SHORT, *FEW, "--out", out)
    with Image.open(out) as image:
        assert image.size == (200, 200)
        assert image.info["duration"] == 100


@pytest.mark.parametrize(
    ("override", "message"),
    [("flow=zero", "keeps no map"), ("tracker=kalman,fixed_lag", "2 experiments, expected one")],
)
def test_a_map_needs_one_filter(tmp_path, override, message):
    with pytest.raises(ConfigError, match=message):
        call("animate-map", "demo", *SHORT, override, "--out", tmp_path / "map.gif")

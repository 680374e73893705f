"""Looking at a stranger's run imports nothing, and stored files that were changed are told."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import ConfigError, DataError, ResultError
from mottrack.experiment.experiment import hash_of, load_experiments
from mottrack.runs.comparison import load_comparison, run_comparison
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution

SMALL = ["dataset.scenes=1", "dataset.duration_s=0.6", "dataset.sweep_hz=10", "dataset.key_hz=10"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, progress) -> Path:
    out = tmp_path_factory.mktemp("finished") / "run"
    config = out.parent / "zero.yaml"
    config.write_text("dataset: synthetic\nflow: zero\nscore_flow: false\n")
    experiments = load_experiments(str(config), SMALL)
    run_comparison(experiments, out, execution=Execution(LocalPool(1)), progress=progress)
    return out


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))


def rewrite(run: Path, **changes: object) -> None:
    """Change the configuration and everything that was noted of it, as a stranger could."""
    file = run / "config.yaml"
    tree = yaml.safe_load(file.read_text()) | changes
    file.write_text(yaml.safe_dump(tree))
    noted = json.loads((run / "run.json").read_text()) | {"configuration": hash_of(tree)}
    (run / "run.json").write_text(json.dumps(noted))


def test_the_stored_configuration_is_the_one_that_ran(copy: Path) -> None:
    assert load_comparison(copy).runs[0].experiment.flow.kind == "zero"
    text = (copy / "config.yaml").read_text()
    (copy / "config.yaml").write_text(text.replace("kind: zero", "kind: icp"))
    with pytest.raises(ResultError, match=r"config\.yaml: settings is those of .*changed after"):
        load_comparison(copy)


def test_a_report_imports_nothing_that_the_run_names(copy: Path, tmp_path: Path) -> None:
    evil = tmp_path / "evil_mod.py"
    evil.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\nclass X: pass\n")
    sys.path.insert(0, str(tmp_path))
    try:
        rewrite(copy, tracker={"kind": "evil_mod:X"}, flow={"kind": "evil_mod:X", "a": 1})
        result = CliRunner().invoke(app, ["report", str(copy)], catch_exceptions=False)
    finally:
        sys.path.remove(str(tmp_path))
    assert result.exit_code == 0, result.output
    assert "evil_mod" not in sys.modules
    assert not (tmp_path / "ran").exists()
    with pytest.raises(ConfigError, match="its parts are not made again"):
        load_comparison(copy).runs[0].experiment.tracker.make()


@pytest.mark.parametrize("text", ["", "null", "{}", "[]", "tracker: 5", "name: [1]", "x: &a [*a]"])
def test_a_configuration_that_is_none(text: str, copy: Path) -> None:
    (copy / "config.yaml").write_text(text)
    (copy / "run.json").write_text("{}")
    with pytest.raises(DataError, match=r"config\.yaml"):
        load_comparison(copy)


DAMAGES = ("[" * 100_000, '{"a": "text"}', '{"a": [NaN]}', '{"a": [-1]}', '{"a": ["1"]}', "[1]")


@pytest.mark.parametrize("text", [*DAMAGES, "", '{"a": ' + "9" * 5000 + "}"])
@pytest.mark.parametrize("suffix", ["timings.json", "latency.json"])
def test_times_that_are_none(text: str, suffix: str, copy: Path) -> None:
    folder = RunFolder(copy)
    (scene,) = folder.scenes
    (copy / "scenes" / f"{scene}.{suffix}").write_text(text)
    with pytest.raises(ResultError, match=suffix.replace(".", r"\.")):
        _ = folder.load(scene), folder.times(scene)


@pytest.mark.parametrize("text", ["", "null", "{}", "# nothing\n"])
def test_an_experiment_without_a_setting(text: str, tmp_path: Path) -> None:
    """It used to run the default experiment."""
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(DataError, match=r"my\.yaml: content is no setting at all"):
        load_experiments(str(path))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("flow=.x:Y", "flow source is '.x:Y', expected package.module:Class, from the top"),
        ("flow=broken_plug_in:Y", "can't be imported: SyntaxError"),
        ("name=" + "9" * 5000, "name is"),
        ("dataset.scenes=" + "9" * 5000, "scenes is .*expected an integer of at most 4300 digits"),
    ],
)
def test_overrides_that_are_none(override: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "broken_plug_in.py").write_text("def (:\n")
    config = tmp_path / "my.yaml"
    config.write_text("dataset: synthetic\n")
    sys.path.insert(0, str(tmp_path))
    try:
        if override.startswith("name"):
            assert load_experiments(str(config), [override])[0].settings.name == "9" * 5000
            return
        with pytest.raises(ConfigError, match=message) as caught:
            load_experiments(str(config), [override])
    finally:
        sys.path.remove(str(tmp_path))
    assert len(str(caught.value)) < 500

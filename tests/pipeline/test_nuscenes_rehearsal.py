"""The rehearsal of nuScenes: what it holds, and every command and configuration on it."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import Pose
from mottrack.core.result import SceneResult
from mottrack.datasets.nuscenes.config import VEHICLE, NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import write_synthetic
from mottrack.eval.nuscenes.prepare import prepare_results
from mottrack.eval.nuscenes.rules import Rules
from mottrack.flow.pillarflow.training.shards import Shards
from mottrack.formats.nuscenes_classes import RACK_CATEGORY, RACKED_CLASSES
from mottrack.objects.clusters import ClusterSource
from mottrack.paper.plan import STUDIES, Request
from mottrack.paper.results import run_studies
from mottrack.paper.studies import studies
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.runner import Execution

DETECTIONS = "detections/synthetic.json"
DOCS = Path(__file__).resolve().parents[2] / "docs"


@dataclass(frozen=True)
class Rehearsal:
    root: Path
    names: tuple[str, ...]

    @property
    def split(self) -> Path:
        """A file with the names: the official splits have more scenes than this has."""
        path = self.root / "scenes.txt"
        path.write_text("\n".join(self.names))
        return path

    def table(self, name: str) -> list[dict]:
        return json.loads(next(self.root.glob(f"v1.0-*/{name}.json")).read_text())


@pytest.fixture(scope="module")
def rehearsal(tmp_path_factory: pytest.TempPathFactory) -> Rehearsal:
    root = tmp_path_factory.mktemp("rehearsal") / "nuscenes"
    world = SyntheticConfig(scenes=2, seed=5, duration_s=2.05)
    return Rehearsal(root, write_synthetic(root, "nuscenes", world))


@pytest.fixture(scope="module")
def mini(tmp_path_factory: pytest.TempPathFactory) -> Rehearsal:
    root = tmp_path_factory.mktemp("rehearsal") / "mini"
    world = SyntheticConfig(scenes=1, seed=6, duration_s=1.05)
    return Rehearsal(root, write_synthetic(root, "nuscenes", world, "v1.0-mini"))


def mottrack(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def of(rehearsal: Rehearsal) -> list[str]:
    return [f"dataset.root={rehearsal.root}", f"dataset.detections={DETECTIONS}"]


def test_it_holds_what_the_real_one_does(rehearsal: Rehearsal, mini: Rehearsal) -> None:
    assert mini.names == ("scene-0103",)
    sweeps = rehearsal.table("sample_data")
    poses = {row["token"] for row in rehearsal.table("ego_pose")}
    assert {row["ego_pose_token"] for row in sweeps} == poses
    assert len(poses) == len(sweeps)
    stamps = sorted(row["timestamp"] for row in sweeps if rehearsal.names[0] in row["filename"])
    assert set(np.diff(stamps)) == {50_000}
    assert sweeps[0]["is_key_frame"]  # no sweep before the first key frame
    mounting = rehearsal.table("calibrated_sensor")[0]["rotation"]
    tilt_rad = np.arccos(Pose.from_quaternion_wxyz(mounting, np.zeros(3)).rotation[2, 2])
    assert 0.01 < tilt_rad < 0.05
    boxes = rehearsal.table("sample_annotation")
    assert any(row["num_lidar_pts"] == 0 for row in boxes)
    assert {row["visibility_token"] for row in boxes} == {"1", "2", "3", "4"}
    assert any(row["attribute_tokens"] for row in boxes)
    detected = json.loads((rehearsal.root / DETECTIONS).read_text())["results"]
    velocity = [box["velocity"] for boxes in detected.values() for box in boxes]
    assert len(velocity) > 50
    assert np.isnan(velocity).all()


def scene_of(rehearsal: Rehearsal, **settings: object):
    dataset = NuScenes(NuScenesConfig(root=rehearsal.root, **settings))
    return dataset.scene(dataset.scene_names[0])


def test_returns_of_the_own_body_are_cut(rehearsal: Rehearsal) -> None:
    """Left in, they are objects that the vehicle never leaves behind."""
    counts = {}
    for outline in (None, VEHICLE):
        scene = scene_of(rehearsal, vehicle=outline)
        index = len(scene) - 1
        sweep, source = scene.sweep(index), ClusterSource()
        found = source.objects(scene.frame(index), sweep)
        ego = found.transformed(sweep.world_T_ego.inverse(), "ego").centre_m
        near = (np.abs(ego[:, 0]) < 4.0) & (np.abs(ego[:, 1]) < 1.5)
        inside = len(sweep) - len(VEHICLE.cut(sweep))
        counts[outline] = (inside, int(near.sum()))
    assert counts[None][0] > 500
    assert counts[None][1] >= 1
    assert counts[VEHICLE] == (0, 0)


def test_trackers_run_on_key_frames_with_sweeps_on_disk(
    rehearsal: Rehearsal, tmp_path: Path
) -> None:
    mottrack("compare", "nuscenes_trackers", *of(rehearsal), "--out", tmp_path, "--workers", 1)
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert [len(run["scenes"]) for run in scores["runs"]] == [2, 2]
    assert all(run["metrics"]["overall"]["matches"] > 50 for run in scores["runs"])


def test_amota_of_a_run_is_that_of_its_submission(rehearsal: Rehearsal, tmp_path: Path) -> None:
    """Racks count in both: two-wheelers that stand in one are not evaluated."""
    run, submission = tmp_path / "run", tmp_path / "submission.json"
    words = [*of(rehearsal), "tracker=kalman", "--workers", 1]
    mottrack("run", "nuscenes_trackers", *words, "--out", run)
    mottrack("submit", run, "--root", rehearsal.root, "--out", submission)
    mottrack(
        *("eval", "nuscenes", "--dataroot", rehearsal.root, "--split", rehearsal.split),
        *("--submission", submission, "--out", tmp_path / "eval"),
    )
    official = json.loads((tmp_path / "eval/metrics_summary.json").read_text())
    own = json.loads((run / "scores.json").read_text())["runs"][0]["metrics"]
    assert own["overall"]["amota"] == pytest.approx(official["amota"], abs=1e-12)
    for label, figures in own["classes"].items():
        assert figures["amota"] == pytest.approx(official["label_metrics"]["amota"][label])


def test_velocity_error_of_a_submission_is_that_of_the_run(
    rehearsal: Rehearsal, tmp_path: Path
) -> None:
    run, submission, still = (tmp_path / name for name in ("run", "own.json", "still.json"))
    words = [*of(rehearsal), "tracker=kalman", "scores.velocity.coasting=true", "--workers", 1]
    mottrack("run", "nuscenes_trackers", *words, "--out", run)
    mottrack("submit", run, "--root", rehearsal.root, "--out", submission)
    content = json.loads(submission.read_text())
    for box in (box for boxes in content["results"].values() for box in boxes):
        box["velocity"] = [0.0, 0.0]
    unknown = [float("nan")] * 2
    next(boxes for boxes in content["results"].values() if boxes)[0]["velocity"] = unknown
    still.write_text(json.dumps(content))
    text = mottrack(
        *("eval", "nuscenes", "--dataroot", rehearsal.root, "--split", rehearsal.split),
        *("--submission", submission, "--compare", still, "--out", tmp_path / "eval"),
        "--no-picture",
    )
    assert "still.json: 1 boxes have no velocity" in text
    found = json.loads((tmp_path / "eval/velocity_error.json").read_text())
    own = json.loads((run / "scores.json").read_text())["runs"][0]["metrics"]["velocity_error"]
    assert found["velocity_error"].keys() == own.keys()
    for row, figures in own.items():
        assert found["velocity_error"][row]["count"] == figures["count"]
        assert found["velocity_error"][row]["mean_mps"] == pytest.approx(figures["mean_mps"])
    fast = [d for d in found["differences"] if (d["row"], d["metric"])[0].startswith("fast")]
    assert fast[0]["difference"] > 1.0  # velocities that are all zero miss what moves


def test_racks_are_left_out_of_every_count(rehearsal: Rehearsal, tmp_path: Path) -> None:
    mottrack(
        *("run", "nuscenes_trackers", *of(rehearsal), "tracker=kalman", "--workers", 1),
        *("--out", tmp_path),
    )
    results = [SceneResult.load(path) for path in sorted(tmp_path.glob("scenes/scene-????.npz"))]
    bare = [replace(r, truth=r.truth.select(r.truth.label != RACK_CATEGORY)) for r in results]
    racked = [Rules().classes.index(name) for name in RACKED_CLASSES]
    boxes = [prepare_results(part, Rules()).truth.label for part in (results, bare)]
    with_racks, without = (int(np.isin(label, racked).sum()) for label in boxes)
    assert with_racks < without


def test_from_files_by_pillarflow_to_the_official_figures(
    rehearsal: Rehearsal, tmp_path: Path
) -> None:
    """Files, flow, tracks, submission, evaluation, by commands alone."""
    words = [*of(rehearsal), f"dataset.scenes=[{rehearsal.names[0]}]", "--out", tmp_path]
    mottrack("compare", "nuscenes_flow_sources", *words, "--workers", 1)
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert [run["flow"] for run in scores["runs"]] == ["zero", "binary_ogm", "pillarflow"]
    assert all(run["metrics"]["flow_error"]["dynamic"]["cells"] > 0 for run in scores["runs"])
    split, submission = tmp_path / "scenes.txt", tmp_path / "submission.json"
    split.write_text(rehearsal.names[0])
    where = ["--root", rehearsal.root, "--split", split, "--out", submission]
    mottrack("submit", tmp_path / "pillarflow", *where)
    text = mottrack(
        *("eval", "nuscenes", "--dataroot", rehearsal.root, "--split", split),
        *("--submission", submission, "--out", tmp_path / "eval", "--no-picture"),
    )
    assert "velocity error of the tracks" in text
    official = json.loads((tmp_path / "eval/metrics_summary.json").read_text())
    own = scores["runs"][2]["metrics"]["overall"]
    assert own["amota"] == pytest.approx(official["amota"], abs=1e-12)


def test_training(rehearsal: Rehearsal, tmp_path: Path) -> None:
    """At 10 Hz without truth between key frames; pairs are drawn until there are enough."""
    config = tmp_path / "train.yaml"
    config.write_text(
        f"network: small\nexamples:\n  dataset: {{kind: nuscenes, root: {rehearsal.root}}}\n"
        "  pairs: 5\n  validation_pairs: 1\n  per_shard: 2\n"
        "steps: 1\nbatch_size: 1\nthreads: 1\n"
    )
    examples = tmp_path / "examples"
    out = mottrack("train", config, "--out", tmp_path / "run", "--examples", examples)
    assert "dynamic_rmse" in out
    made = Shards(next(examples.iterdir()) / "training")
    assert len(made) == 5
    assert max(np.abs(example.motion_m).max() for example in made) > 0.1


def nuscenes_commands() -> list[str]:
    text = "\n".join(path.read_text() for path in sorted(DOCS.glob("*.md")))
    lines = re.findall(
        r"^mottrack (?:eval nuscenes|run nusc|compare nusc|submit out).*$", text, re.M
    )
    return sorted(set(lines))


def test_commands_of_the_documentation(
    rehearsal: Rehearsal, mini: Rehearsal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MOTTRACK_CACHE", str(tmp_path / "cache"))
    lines = nuscenes_commands()
    assert len(lines) >= 6
    order = ("run", "compare", "submit", "eval")
    for line in sorted(lines, key=lambda line: order.index(line.split()[1])):
        small = "v1.0-mini" in line
        data = mini if small else rehearsal
        words = shlex.split(line, comments=True)[1:]
        words = [re.sub(r"(path/to/nuscenes|\bD)$", str(data.root), word) for word in words]
        words = [re.sub(r"=(detections|result)\.json$", f"={DETECTIONS}", word) for word in words]
        words = ["submission.json" if word == "tracks.json" else word for word in words]
        if words[0] == "eval":
            split = ["--split", str(data.split)]
            words = [w for w in words if w not in ("--split", "mini_val")] + split
            if small:
                mottrack(
                    "run",
                    "nuscenes_trackers",
                    *of(mini),
                    "dataset=nuscenes_mini",
                    "tracker=kalman",
                    "--out",
                    "out/mini",
                    "--workers",
                    1,
                )
                mottrack(
                    "submit",
                    "out/mini",
                    "--root",
                    mini.root,
                    "--split",
                    "mini_val",
                    "--out",
                    "mini.json",
                )
                words = ["mini.json" if word == "submission.json" else word for word in words]
        if words[0] == "compare" and "flow" in words[1]:
            words.append(f"dataset.scenes=[{data.names[0]}]")
        mottrack(*words, *(["--workers", "1"] if words[0] in ("run", "compare") else []))


def test_the_studies_of_the_paper(mini: Rehearsal, tmp_path: Path, progress) -> None:
    settings = (f"nuscenes.detections={DETECTIONS}",)
    request = Request(tmp_path, quick=True, roots={"nuscenes": mini.root}, settings=settings)
    wanted = [study for study in studies(request) if study.dataset == "nuscenes"]
    assert {study.name for study in wanted if not study.reason} == set(STUDIES)
    results = run_studies(
        wanted, tmp_path / "runs", execution=Execution(LocalPool(1)), progress=progress
    )
    assert not results.failed

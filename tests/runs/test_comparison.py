import json
import os
import shutil
import weakref
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError
from mottrack.core.result import SceneResult
from mottrack.eval.evaluation import BATCH, Evaluation
from mottrack.eval.nuscenes.metrics import evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare_results, rules_for
from mottrack.eval.nuscenes.resampling import evaluate_weighted, profiles
from mottrack.eval.paired import draw
from mottrack.eval.run_metrics import OFFICIAL, Resampling, run_metrics
from mottrack.eval.scores import ScoreConfig
from mottrack.eval.velocity_error import velocity_samples, velocity_table
from mottrack.experiment.experiment import compose, load_experiments
from mottrack.report.page import write_report
from mottrack.runs.comparison import Comparison, load_comparison, run_comparison, score_runs
from mottrack.runs.comparison_tables import comparison_tables, significance
from mottrack.runs.differences import check_baseline, find_differences
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.tasks import Progress
from mottrack.runs.terminal import closing_text, comparison_text
from mottrack.runs.velocity_bench import VELOCITY, flow_values, plain_words

TREE = {
    "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": ["a", "b", "poison", "c"]},
    "flow": ["zero", "ground_truth"],
    "tracker": {"kind": "toy_plugins:EchoTracker"},
}


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory, progress: Progress) -> Comparison:
    runs = compose(TREE, [], Path("experiment.yaml"))
    return run_comparison(
        runs,
        tmp_path_factory.mktemp("comparison"),
        execution=Execution(LocalPool(2)),
        progress=progress,
    )


def test_runs_are_paired_over_the_scenes_that_both_have(comparison: Comparison) -> None:
    (part,) = comparison.differences
    assert (part.baseline, part.run, part.scenes) == ("zero", "ground_truth", 3)
    fast = next(r for r in part.rows if r.key.row.startswith("fast") and r.key.metric == "mean")
    assert fast.better
    assert fast.difference == pytest.approx(fast.value - 10.0)
    stored = json.loads((comparison.out / "scores.json").read_text())["differences"][0]
    assert stored["scenes"] == 3
    tables = {"tracking", "velocity", "flow", "sceneflow"}
    assert {f["table"] for f in stored["figures"]} == tables
    table = {t.name: t for t in comparison_tables(comparison)}["differences"]
    assert len(table.rows) == len(part.rows)
    assert "better" in {row[8] for row in table.rows}


def test_any_run_can_be_the_baseline_but_it_must_exist(comparison: Comparison) -> None:
    found = find_differences(comparison.runs, "ground_truth")
    assert [(p.baseline, p.run) for p in found] == [("ground_truth", "zero")]
    with pytest.raises(ConfigError, match="did you mean 'ground_truth'"):
        check_baseline([run.experiment for run in comparison.runs], "ground_truht")


def test_one_scene_has_no_interval_and_other_data_no_difference(comparison: Comparison) -> None:
    first, second = comparison.runs

    def with_scenes(run: ScoredRun, *scenes: str) -> ScoredRun:
        return replace(run, report=replace(run.report, finished=scenes))

    (alone,) = find_differences([with_scenes(first, "a"), second], None)
    assert {significance(row) for row in alone.rows} == {"one scene"}
    kitti = replace(second.experiment, dataset=replace(second.experiment.dataset, kind="kitti"))
    assert find_differences([first, replace(second, experiment=kitti)], None) == ()
    assert find_differences([first, with_scenes(second, "z")], None) == ()


def test_figures_are_those_of_the_tables_and_of_the_official_evaluation(
    comparison: Comparison,
) -> None:
    run = comparison.runs[1]
    results: list[SceneResult] = [run.folder.load(scene) for scene in run.report.finished]
    evaluation = Evaluation(results, ScoreConfig())
    common = Resampling.of([evaluation], resamples=5)
    figures = {(k.table, k.row, k.metric): v for k, v in run_metrics(evaluation, common).items()}
    for (table, row, metric), sampled in figures.items():
        if table == "velocity":
            error = run.scores.velocity[row]
            known = error.mean_mps if metric == "mean" else error.worst_mean_mps
            assert sampled.value == pytest.approx(known)
    flow = run.scores.flow["dynamic"]
    assert figures["flow", "dynamic", "RMSE"].value == pytest.approx(flow.rmse_mps)
    assert figures["flow", "dynamic", "RMSE of the flow"].value == pytest.approx(flow.rmse_m)
    assert figures["flow", "dynamic", "AAE"].value == pytest.approx(flow.aae_rad)
    rules = rules_for(["car"])
    prepared = prepare_results(results, rules)
    official = evaluate_prepared(prepared, rules).total
    classes = profiles(prepared, rules)
    weights = draw(len(results), 5)
    again = [evaluate_weighted(classes, weight, rules).total for weight in weights]
    for key in OFFICIAL:
        sampled = figures["tracking", "all", key.metric]
        assert sampled.value == pytest.approx(official[key.metric.lower()])
        np.testing.assert_allclose(sampled.draws, [row[key.metric.lower()] for row in again])


def test_a_resample_of_the_velocity_table_is_that_of_the_copied_scenes(
    comparison: Comparison,
) -> None:
    run = comparison.runs[0]
    results = [run.folder.load(scene) for scene in run.report.finished]
    evaluation = Evaluation(results, ScoreConfig())
    common = Resampling.of([evaluation], resamples=4)
    figures = run_metrics(evaluation, common)
    for b, weight in enumerate(common.weights):
        copies = [r for r, w in zip(results, weight, strict=True) for _ in range(w)]
        table = velocity_table([velocity_samples(r) for r in copies])
        for key, sampled in figures.items():
            if key.table == "velocity" and key.metric == "mean":
                assert sampled.draws[b] == pytest.approx(table[key.row].mean_mps)


class Watched(SceneResult):
    """A result of which is known whether it still exists."""

    __slots__ = ("__weakref__",)


def test_a_report_holds_few_results_at_once(
    comparison: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many scenes there are: a batch of boxes, and the last scene of each run."""
    read: list[weakref.ref[SceneResult]] = []
    held: list[int] = []
    load = RunFolder.load

    def watched(folder: RunFolder, scene: str, **options: bool) -> SceneResult:
        result = load(folder, scene, **options)
        found = Watched(*(getattr(result, f.name) for f in fields(result)))
        read.append(weakref.ref(found))
        held.append(sum(each() is not None for each in read))
        return found

    for run in comparison.runs:
        folder = RunFolder(tmp_path / run.experiment.variant)
        shutil.copytree(run.folder.path, folder.path)
        for k in range(3 * BATCH):
            for file in (folder.scene_file, folder.timings_file, folder.latency_file):
                os.link(file("a"), file(f"a{k}"))
    monkeypatch.setattr(RunFolder, "load", watched)
    write_report(load_comparison(tmp_path), tmp_path / "report.html")
    assert len(held) > 2 * 3 * BATCH
    assert max(held) <= BATCH + 2 * len(comparison.runs)


def test_what_flow_was_worth_is_tabulated_and_told(comparison: Comparison) -> None:
    (value,) = comparison.flow_values
    assert (value.run, value.baseline, value.oracle) == ("ground_truth", "zero", True)
    assert value.shares == ()
    velocity = value.row(VELOCITY)
    assert velocity is not None
    assert velocity.better
    change = value.changes[VELOCITY]
    assert change.share == pytest.approx(velocity.difference / velocity.baseline)
    assert change.low <= change.share <= change.high
    tables = {table.name: table for table in comparison_tables(comparison)}
    assert next(row[1] for row in tables["flow_value"].rows) == "all, velocity error"
    assert plain_words(comparison.flow_values) == []  # the truth is no measured flow
    lines = plain_words([replace(value, oracle=False)])
    assert len(lines) == 3
    assert f"{velocity.baseline:.3f} -> {velocity.value:.3f} m/s" in lines[0]
    assert lines[0].endswith("better.")
    assert "no share" in lines[2]
    assert "AMOTA" in lines[2]
    assert flow_values(comparison.runs[1:]) == []  # nothing to compare with


def test_runs_of_a_tracker_that_ignores_the_flow_are_shown_once(
    tmp_path: Path, progress: Progress
) -> None:
    world = ["dataset.scenes=2", "dataset.duration_s=1.5", "objects=detections"]
    experiments = load_experiments(
        "demo", [*world, "flow=zero,cluster_icp", "tracker=stanford_iprl_tri"]
    )
    comparison = run_comparison(
        experiments, tmp_path, execution=Execution(LocalPool(1)), progress=progress
    )
    assert comparison.equal == {"cluster_icp": "zero"}
    text = "\n".join([*comparison_text(comparison, 100), *closing_text(comparison)])
    assert "equal: the tracks of cluster_icp equal those of zero; its tracker ignores" in text
    tracking = text[text.index("Tracking") : text.index("Velocity error")]
    assert "zero" in tracking
    assert "cluster_icp" not in tracking
    assert "cluster_icp" in text[text.index("Flow error") :]


def test_what_a_killed_driver_left_half_written_is_removed(
    comparison: Comparison, tmp_path: Path
) -> None:
    out = tmp_path / "again"
    shutil.copytree(comparison.out, out)
    for folder in (out, out / "tables"):
        folder.mkdir(exist_ok=True)
        (folder / ".scores.json.killed.part").write_bytes(b"half")
    score_runs(comparison.runs, out)
    assert not list(out.rglob("*.part"))

"""Damages do what they say, the same for everyone; a tracker under them gets worse."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import ConfigError
from mottrack.core.objects import Objects
from mottrack.core.pose import Pose
from mottrack.eval.paired import Ratio, draw, sample
from mottrack.experiment.experiment import load_experiments
from mottrack.studies.stress.damage import DAMAGES, Moment
from mottrack.studies.stress.stressed import Stress, StressedFlow, StressedScene
from mottrack.studies.stress.study import Outcome, breaking_amount, hurting_amount

COUNT = 2000


def moment(since_s: float = 0.0) -> Moment:
    rng = np.random.default_rng(1)
    boxes = Objects(
        stamp_ns=1,
        centre_m=rng.uniform(-40, 40, (COUNT, 3)),
        size_m=np.tile([4.0, 2.0, 1.5], (COUNT, 1)),
        yaw_rad=np.zeros(COUNT),
        label=np.array(["car", "bus"])[rng.integers(0, 2, COUNT)],
        score=rng.random(COUNT),
    )
    return Moment(boxes, Pose.identity(), since_s, np.random.default_rng(2))


def damaged(kind: str, amount: float, since_s: float = 0.0) -> tuple[Objects, Objects]:
    damage = DAMAGES[kind].detections
    assert damage is not None
    before = moment(since_s)
    return before.detections, damage(before, amount)


def test_each_kind_has_the_amount_that_it_is_given() -> None:
    before, after = damaged("dropout", 0.3)
    assert len(after) == pytest.approx(0.7 * COUNT, rel=0.05)
    before, after = damaged("jitter", 0.5)
    apart = after.centre_m - before.centre_m
    assert apart[:, :2].std() == pytest.approx(0.5, rel=0.05)
    assert not apart[:, 2].any()
    before, after = damaged("size", 0.2)
    assert np.log(after.size_m / before.size_m).std() == pytest.approx(0.2, rel=0.05)
    before, after = damaged("heading", 0.3)
    assert (after.yaw_rad - before.yaw_rad).std() == pytest.approx(0.3, rel=0.05)
    before, after = damaged("clutter", 50.0)
    assert len(after) - COUNT == pytest.approx(50, abs=25)
    before, after = damaged("confusion", 0.4)
    assert (after.label != before.label).mean() == pytest.approx(0.2, abs=0.03)


def test_a_burst_blinds_a_quarter_for_its_time() -> None:
    assert len(damaged("burst", 1.0, since_s=0.9)[1]) == pytest.approx(0.75 * COUNT, rel=0.05)
    assert len(damaged("burst", 1.0, since_s=1.1)[1]) == COUNT
    assert len(damaged("burst", 1.0, since_s=4.5)[1]) < COUNT


def test_frames_are_lost_whole() -> None:
    lengths = set()
    for seed in range(20):
        some = Moment(moment().detections, Pose.identity(), 0.0, np.random.default_rng(seed))
        damage = DAMAGES["lost_frame"].detections
        assert damage is not None
        lengths.add(len(damage(some, 0.5)))
    assert lengths == {0, COUNT}


def scene_of(*overrides: str) -> StressedScene:
    experiment = load_experiments("demo", ["flow=zero", "dataset.duration_s=3", *overrides])[0]
    dataset = experiment.dataset.make()
    return StressedScene(dataset.scene(dataset.scene_names[0]), Stress("", 0.0))


def test_late_detections_are_those_of_an_earlier_key_frame() -> None:
    plain = scene_of().scene
    late = StressedScene(plain, Stress("late", 2.0))
    keys = [i for i in range(len(plain)) if plain.frame(i).detections is not None]
    first, third = late.frame(keys[0]).detections, late.frame(keys[3]).detections
    assert first is not None
    assert len(first) == 0
    assert third is not None
    np.testing.assert_array_equal(third.centre_m, plain.frame(keys[1]).detections.centre_m)
    assert third.stamp_ns == plain.frame(keys[3]).stamp_ns


def test_drift_moves_all_that_the_vehicle_knows_and_nothing_relative_to_it() -> None:
    plain = scene_of().scene
    drifted = StressedScene(plain, Stress("drift", 1.0))
    index = len(plain) - 1
    before, after = plain.frame(index), drifted.frame(index)
    since_s = (before.stamp_ns - plain.frame(0).stamp_ns) * 1e-9
    moved = after.world_T_ego.translation_m - before.world_T_ego.translation_m
    assert np.hypot(*moved[:2]) == pytest.approx(since_s, rel=0.2)
    for name in ("truth", "detections"):
        sides = [
            getattr(f, name).transformed(f.world_T_ego.inverse(), "ego") for f in (before, after)
        ]
        np.testing.assert_allclose(sides[0].centre_m, sides[1].centre_m, atol=1e-9)


def test_damage_is_the_same_for_everyone() -> None:
    scene = StressedScene(scene_of().scene, Stress("dropout", 0.5))
    twice = [scene.frame(0).detections, scene.frame(0).detections]
    np.testing.assert_array_equal(twice[0].centre_m, twice[1].centre_m)


@pytest.mark.parametrize("kind", ["flow_noise", "flow_lost", "flow_late"])
def test_flow_gets_worse(kind: str) -> None:
    experiment = load_experiments("demo", ["flow=ground_truth", "dataset.duration_s=1"])[0]
    grid = experiment.settings.grid.grid()
    dataset = experiment.dataset.make()
    scene = dataset.scene(dataset.scene_names[0])
    plain, worse = experiment.flow.make(grid=grid), experiment.flow.make(grid=grid)
    stressed = StressedFlow(worse, Stress(kind, 1.0))
    fields = []
    for index in range(3):
        for source in (plain, stressed):
            source.observe(scene.frame(index))
        if index:
            pair = scene.sweep(index - 1), scene.sweep(index)
            fields.append((plain.estimate(pair[:1], pair[1]), stressed.estimate(pair[:1], pair[1])))
    true, found = fields[-1]
    assert found.stamp_ns == true.stamp_ns
    if kind == "flow_late":
        np.testing.assert_array_equal(found.velocity_mps, fields[0][0].velocity_mps)
    elif kind == "flow_lost":
        assert not found.velocity_mps.any()
    else:
        error = (found.velocity_mps - true.velocity_mps)[true.valid]
        assert error.std() == pytest.approx(1.0, rel=0.05)


def outcome(amount: float, scenes: list[float]) -> Outcome:
    level = np.array(scenes)
    figure = sample(Ratio(level, np.ones(len(level))), draw(len(level), 100))
    return Outcome("a", Stress("jitter", amount), {"hota": figure})


def test_where_a_tracker_is_worse_and_where_it_breaks() -> None:
    """The loss of 0.01 differs between scenes by more than its mean, that of 0.2 does not."""
    clean = [0.5, 0.6, 0.7, 0.6]
    losses = ([0, 0, 0, 0], [-0.1, 0.15, -0.1, 0.09], [0.2, 0.21, 0.19, 0.2], [0.4, 0.4, 0.4, 0.4])
    found = [
        outcome(amount, [c - loss for c, loss in zip(clean, of_scene, strict=True)])
        for amount, of_scene in enumerate(losses)
    ]
    assert hurting_amount(found, "hota") == 2
    assert breaking_amount(found, "hota") == 3
    assert breaking_amount(found[:3], "hota") is None
    assert hurting_amount(found[:2], "hota") is None


def test_the_command_and_its_files(tmp_path: Path) -> None:
    command = ["stress", "demo", "flow=zero", "dataset.scenes=2", "dataset.duration_s=3"]
    command += ["tracker=kalman,toy_plugins:EchoTracker", "--bootstrap", "20"]
    done = CliRunner().invoke(app, [*command, "--kinds", "dropout", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    rows = json.loads((tmp_path / "stress.json").read_text())
    steps = list(DAMAGES["dropout"].steps)
    first, other = rows[::2], rows[1::2]
    assert [row["amount"] for row in first] == [row["amount"] for row in other] == steps
    assert first[-1]["figures"]["recall"]["value"] < first[0]["figures"]["recall"]["value"]
    assert first[-1]["to_undamaged"]["recall"]["better"] is False
    assert {"difference", "low", "high"} <= other[0]["to_first_tracker"]["hota"].keys()
    assert (tmp_path / "stress.png").is_file()
    assert "Breaks: half of" in " ".join(done.output.split())
    done = CliRunner().invoke(app, [*command, "--kinds", "fog", "--out", str(tmp_path)])
    assert isinstance(done.exception, ConfigError)

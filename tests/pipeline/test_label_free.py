"""Flow judged without labels: the true flow must win, and no flow must not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mottrack.core.errors import ResultError
from mottrack.core.storage import write_arrays
from mottrack.eval.label_free import (
    CONSISTENT,
    ERROR,
    EXPLAINED,
    MOVING,
    NAMES,
    NIS,
    STATIC,
    LabelFreeSums,
    SceneJudgements,
    load_judgement,
    save_judgement,
    total,
)
from mottrack.eval.paired import whole
from mottrack.experiment.experiment import load_experiments
from mottrack.flow.ground_truth import GroundTruthFlow
from mottrack.flow.zero import ZeroFlow
from mottrack.pipeline.label_free import CHECK_GRID, Evidence, Reversal
from mottrack.pipeline.label_free_sampler import Evidences
from mottrack.pipeline.mirrored import mirrored_frame, mirrored_sweep
from mottrack.pipeline.scene_run import run_scene
from tests.flow.conftest import Street

STREET = {"speed_mps": 6.0, "ego_mps": 3.0}
NOW = 4
"""Step of the street that is judged: the earlier sweep is three before it."""


def figures(sums: LabelFreeSums):
    return {key: whole(SceneJudgements((sums,)).metric(key)) for key in (ERROR, MOVING, STATIC)}


@pytest.fixture(scope="module")
def judged():
    """The evidence of one sweep of the street, and the true field at it."""
    street = Street(**STREET)
    source = GroundTruthFlow(grid=CHECK_GRID)
    for step in (NOW - 1, NOW):
        source.observe(street.frame(step))
    field = source.estimate((street.sweep(NOW - 1),), street.sweep(NOW))
    return Evidences().of(street.sweep(NOW - 3), street.sweep(NOW)), field


def with_velocity(field, velocity_mps):
    return replace(field, velocity_mps=np.asarray(velocity_mps, np.float32))


def test_the_car_moved_and_the_walls_rested(judged):
    evidence, _ = judged
    rows, cols, _ = CHECK_GRID.cells(evidence.xyz_m)
    on_car = Street(**STREET).car_cells(NOW, CHECK_GRID)[rows, cols]
    assert evidence.moving[on_car].mean() > 0.9
    assert not evidence.moving[~on_car].any()
    assert evidence.static[~on_car].mean() > 0.3
    assert not evidence.static[on_car].any()


def test_the_true_flow_beats_none_and_any_other_on_what_moves(judged):
    evidence, field = judged
    true = figures(evidence.judge(field))
    zero = figures(evidence.judge(with_velocity(field, np.zeros_like(field.velocity_mps))))
    assert true[STATIC] == zero[STATIC] == 0.0
    assert zero[MOVING] > 3.0 > 0.5 > true[MOVING]
    for factor in (0.6, 0.8, 1.3, -1.0):
        other = figures(evidence.judge(with_velocity(field, factor * field.velocity_mps)))
        assert true[ERROR] < other[ERROR], factor


def test_an_invented_motion_costs_what_rests(judged):
    evidence, field = judged
    invented = with_velocity(field, field.velocity_mps + np.array([1.5, 0.0]))
    found = figures(evidence.judge(invented))
    assert found[STATIC] == pytest.approx(1.5, abs=1e-3)
    assert found[ERROR] > figures(evidence.judge(field))[ERROR]


def test_no_flow_explains_nothing_and_is_nowhere_consistent(judged):
    evidence, field = judged
    zero = with_velocity(field, np.zeros_like(field.velocity_mps))
    sums = evidence.judge(zero)
    assert whole(SceneJudgements((sums,)).metric(EXPLAINED)) == pytest.approx(0.0, abs=1e-6)
    better = SceneJudgements((evidence.judge(field),)).metric(EXPLAINED)
    assert whole(better) > 1.0


def test_flow_of_the_reversed_pair_is_opposite_for_the_truth_alone(judged):
    evidence, field = judged
    street, source = Street(**STREET), GroundTruthFlow(grid=CHECK_GRID)
    now, before = street.sweep(NOW), street.sweep(NOW - 1)
    for step in (NOW, NOW - 1):
        source.observe(mirrored_frame(street.frame(step), now.stamp_ns))
    past, current = (mirrored_sweep(sweep, now.stamp_ns) for sweep in (now, before))
    pair = Evidences().prepared(before, now)
    back = source.estimate((past,), current)
    agree = Reversal(back, pair).agreement(evidence, field)
    assert agree.agreeing > 0.9 * agree.reversed > 0
    at_rest = ZeroFlow(grid=CHECK_GRID).estimate((past,), current)
    assert Reversal(at_rest, pair).agreement(evidence, field).agreeing == 0
    unmoved = with_velocity(field, np.zeros_like(field.velocity_mps))
    assert Reversal(at_rest, pair).agreement(evidence, unmoved).agreeing == 0


def test_sums_add_up_and_survive_a_file(judged, tmp_path):
    evidence, field = judged
    one = evidence.judge(field)
    assert figures(total([one, one])) == pytest.approx(figures(one))
    save_judgement(tmp_path / "x.npz", one)
    assert load_judgement(tmp_path / "x.npz") == one
    write_arrays(tmp_path / "y.npz", {"sums": np.zeros(len(NAMES))}, "other")
    with pytest.raises(ResultError, match="format"):
        load_judgement(tmp_path / "y.npz")


@pytest.mark.parametrize(("wanted", "judged_frames"), [("always", 3), ("auto", 0), ("never", 0)])
def test_a_run_judges_what_its_setting_says(wanted, judged_frames):
    overrides = ["dataset.scenes=1", "dataset.duration_s=2.0", "flow=ground_truth"]
    (experiment,) = load_experiments("demo", [*overrides, f"label_free={wanted}"])
    dataset = experiment.dataset.make()
    run = run_scene(experiment, dataset.scene(dataset.scene_names[0]))
    frames = 0 if run.label_free is None else run.label_free.frames
    assert frames == judged_frames
    if run.label_free is not None:
        known = partial(SceneJudgements((run.label_free,)).metric)
        assert whole(known(NIS)) > 0
        assert whole(known(CONSISTENT)) > 50


def test_evidence_of_an_empty_sweep_is_none():
    street = Street(**STREET)
    empty = street.sweep(NOW).select(np.zeros(0, np.int64))
    evidence = Evidence.of(Evidences().prepared(street.sweep(NOW - 3), empty))
    assert not len(evidence.xyz_m)

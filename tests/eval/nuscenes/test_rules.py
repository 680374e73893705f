"""Single rules of the official evaluation, on cases small enough to work out by hand."""

from collections.abc import Callable
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from mottrack.core.errors import InputError
from mottrack.eval.nuscenes.assignment import make_solver, solve
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Racks, Samples
from mottrack.eval.nuscenes.levels import ScoreCounts, recall_levels
from mottrack.eval.nuscenes.metrics import class_scenes, evaluate, run_at
from mottrack.eval.nuscenes.prepare import fill_gaps, kept_boxes, mean_scores, prepare
from mottrack.eval.nuscenes.rules import Rules


def samples(frames: int) -> Samples:
    return Samples(
        scene_name=np.array(["scene-0003"]),
        first=np.array([0, frames]),
        token=np.array([f"t{k}" for k in range(frames)]),
        stamp_us=np.arange(frames) * 500_000,
        ego_xy_m=np.zeros((frames, 2)),
    )


def boxes(*rows: tuple[int, int, float, float]) -> BoxTable:
    """Cars of (sample, track, x, score)."""
    values = np.array(rows, np.float64).reshape(-1, 4)
    return BoxTable(
        sample=values[:, 0].astype(np.int64),
        track=values[:, 1].astype(np.int64),
        label=np.full(len(values), 2, np.int8),
        centre_m=np.column_stack([values[:, 2], np.zeros((len(values), 2))]),
        score=values[:, 3].copy(),
        num_points=np.full(len(values), 3),
    )


def test_gaps_are_filled_with_swapped_weights_unless_fixed() -> None:
    given = boxes((0, 0, 0.0, 1.0), (4, 0, 4.0, 1.0))
    official = fill_gaps(given, samples(5), Rules())
    fixed = fill_gaps(given, samples(5), Rules(interpolation="fixed"))
    np.testing.assert_allclose(official.centre_m[:, 0], [0, 3, 2, 1, 4])
    np.testing.assert_allclose(fixed.centre_m[:, 0], [0, 1, 2, 3, 4])
    assert official.num_points.tolist() == [3, -1, -1, -1, 3]


def test_mean_scores_are_those_of_numpy_to_the_last_bit() -> None:
    rng = np.random.default_rng(0)
    lengths = [1, 3, 7, 8, 9, 40, 128, 129, 300]
    track = np.repeat(np.arange(len(lengths)), lengths)
    score = rng.random(len(track))
    order = rng.permutation(len(track))
    table = boxes(*((0, 0, 0.0, 0.0) for _ in track))
    shuffled = BoxTable(
        table.sample, track[order], table.label, table.centre_m, score[order], table.num_points
    )
    got = mean_scores(shuffled)
    for number in range(len(lengths)):
        rows = track[order] == number
        assert set(got[rows]) == {np.mean(score[order][rows].tolist())}


def test_range_is_strict_and_boxes_without_points_and_in_racks_are_dropped() -> None:
    rack = Racks(np.array([0]), np.zeros((1, 3)), np.full((1, 3), 4.0), np.array([[1.0, 0, 0, 0]]))
    table = boxes(*((0, k, x, 1.0) for k, x in enumerate((49.999, 50.0, 1.0, 2.0, 2.1, 1.0))))
    table.label[2:5] = 0
    table.num_points[5] = 0
    kept = kept_boxes(table, GroundTruth(samples(1), table, rack), Rules())
    assert kept.tolist() == [True, False, False, False, True, False]


def test_a_match_is_kept_over_a_gap_and_a_change_of_identity_is_a_switch() -> None:
    truth = boxes(*((f, 0, 0.0, -1.0) for f in range(6)))
    # identity 1 in frames 0 and 4, where a nearer 2 stands beside it; 3 alone in frame 5
    tracks = boxes((0, 1, 1.0, 0.9), (4, 1, 1.0, 0.9), (4, 2, 0.1, 0.9), (5, 3, 0.5, 0.9))
    data = prepare(GroundTruth(samples(6), truth, Racks.none()), tracks, Rules())
    scenes = class_scenes(data, 2, Rules())
    tally = run_at(scenes, 0.0)
    assert scenes.truth["event"][:-1].tolist() == [1, 1, 1, 1, 1, 2]
    assert tally.counts[0, :5].tolist() == [5, 1, 0, 1, 6]


def test_solver_answers_as_scipy_does_even_where_costs_are_equal() -> None:
    rng = np.random.default_rng(0)
    call = numba.njit(lambda s, rows, columns: solve(s, rows, columns))
    for _ in range(300):
        rows = int(rng.integers(1, 9))
        columns = int(rng.integers(rows, 12))
        cost = rng.integers(0, 4, (rows, columns)).astype(np.float64)
        solver = make_solver(12)
        solver.cost[:rows, :columns] = cost
        call(solver, rows, columns)
        assert solver.row["column"][:rows].tolist() == linear_sum_assignment(cost)[1].tolist()


def test_thresholds_lie_between_scores_and_unreached_levels_have_none() -> None:
    threshold, recall = recall_levels(ScoreCounts.of(np.array([0.9, 0.5])), 4, Rules())
    assert (recall[0], recall[-1]) == (1.0, 0.1)
    assert np.isnan(threshold[recall > 0.5]).all()
    assert threshold[-1] == 0.9
    inside = threshold[(recall > 0.25) & (recall <= 0.5)]
    assert ((inside >= 0.5) & (inside < 0.9)).all()
    assert (np.diff(inside) > 0).all()


def test_perfect_predictions_score_one_and_none_is_an_error() -> None:
    truth = boxes(*((f, k, 3.0 * k, -1.0) for f in range(10) for k in range(4)))
    given = GroundTruth(samples(10), truth, Racks.none())
    total = evaluate(given, truth.with_score(np.full(40, 0.5))).classes["car"]
    assert (total["amota"], total["mota"], total["recall"]) == (1.0, 1.0, 1.0)
    assert (total["amotp"], total["mt"]) == (0.0, 4)
    with pytest.raises(InputError, match="predictions is 0 boxes"):
        evaluate(given, truth.select(np.zeros(0, np.int64)))


def test_arrays_that_do_not_fit_are_input_errors(
    make_problem: Callable[..., tuple[GroundTruth, BoxTable]],
) -> None:
    truth, tracks = make_problem(1)
    ones = np.ones(len(tracks))
    faults = [
        (replace(tracks, sample=tracks.sample + 1000), "predictions.sample is between"),
        (replace(tracks, label=tracks.label + np.int8(7)), "predictions.label is between"),
        (replace(tracks, score=ones * np.nan), "predictions.score is NaN"),
        (replace(tracks, score=ones[1:]), "predictions.score is .* long"),
    ]
    for broken, complaint in faults:
        with pytest.raises(InputError, match=complaint):
            evaluate(truth, broken)

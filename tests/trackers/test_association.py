"""Candidates, costs and assignment against brute force, scipy and shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from mottrack.geometry.iou import bev_corners
from mottrack.trackers.association import (
    ASSIGNMENTS,
    OVERLAPS,
    candidate_pairs,
    greedy,
    hungarian,
    mutual_nearest,
    overlap_cost,
)
from mottrack.trackers.kalman.detections import non_maximum_suppression

NONE = (np.empty(0, np.int64), np.empty(0, np.int64))


@given(st.integers(0, 10_000), st.integers(0, 25), st.integers(0, 25), st.booleans())
@settings(max_examples=60, deadline=None)
def test_candidates_are_those_of_brute_force(seed: int, n: int, m: int, grouped: bool) -> None:
    rng = np.random.default_rng(seed)
    left, right = rng.uniform(-9, 9, (n, 2)), rng.uniform(-9, 9, (m, 2))
    reach = rng.uniform(0, 6, m)
    groups = (rng.integers(0, 3, n), rng.integers(0, 3, m)) if grouped else None
    near = (np.abs(left[:, None] - right[None]) <= reach[None, :, None]).all(axis=2)
    if groups is not None:
        near &= groups[0][:, None] == groups[1][None]
    i, j = candidate_pairs(left, right, reach, groups)
    np.testing.assert_array_equal(np.stack([i, j]), np.stack(np.nonzero(near)))


def some_pairs(seed: int, n: int = 12, m: int = 9) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(-3, 3, (n, m)).round(1)
    return cost, rng.random((n, m)) < 0.3


@pytest.mark.parametrize("seed", range(20))
def test_hungarian_equals_scipy_on_the_whole_matrix(seed: int) -> None:
    cost, allowed = some_pairs(seed)
    pairs = np.nonzero(allowed)
    chosen = hungarian(cost[pairs], pairs)
    dense = np.where(allowed, cost, 1e4)
    rows, columns = linear_sum_assignment(dense)
    kept = dense[rows, columns] < 1e4
    assert len(chosen) == kept.sum()
    assert cost[pairs][chosen].sum() == pytest.approx(dense[rows, columns][kept].sum())


@pytest.mark.parametrize("seed", range(5))
def test_greedy_takes_the_cheapest_first_and_mutual_pairs_are_among_them(seed: int) -> None:
    cost, allowed = some_pairs(seed)
    pairs = np.nonzero(allowed)
    matrix, expected = np.where(allowed, cost, np.inf), []
    while np.isfinite(matrix).any():
        i, j = np.unravel_index(matrix.argmin(), matrix.shape)
        expected.append((i, j))
        matrix[i, :] = matrix[:, j] = np.inf
    chosen = greedy(cost[pairs], pairs)
    assert list(zip(pairs[0][chosen], pairs[1][chosen], strict=True)) == expected
    assert set(mutual_nearest(cost[pairs], pairs)) <= set(chosen)


@pytest.mark.parametrize("method", sorted(ASSIGNMENTS))
def test_equal_costs_are_settled_the_same_way_every_time(method: str) -> None:
    pairs = (np.array([1, 0, 0, 1]), np.array([0, 1, 0, 1]))
    chosen = ASSIGNMENTS[method](np.ones(4), pairs)
    expected = {(0, 0)} if method == "mutual_nearest" else {(0, 0), (1, 1)}
    assert {(pairs[0][k], pairs[1][k]) for k in chosen} == expected
    assert len(ASSIGNMENTS[method](np.empty(0), NONE)) == 0


def boxes(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [
            rng.uniform(-5, 5, (n, 2)),
            rng.normal(0, 0.3, n),
            rng.uniform([2, 1, 1], [5, 2, 2], (n, 3)),
            rng.uniform(-3, 3, n),
        ]
    )


@pytest.mark.parametrize("name", sorted(OVERLAPS))
def test_overlap_cost_is_one_less_the_overlap_of_each_pair(name: str) -> None:
    a, b = boxes(1, 8), boxes(2, 6)
    pairs = np.nonzero(np.random.default_rng(3).random((8, 6)) < 0.5)
    np.testing.assert_allclose(
        overlap_cost(a, b, pairs, name), 1 - OVERLAPS[name](a, b)[pairs], atol=1e-12
    )


def test_suppression_leaves_no_overlap_and_no_gap() -> None:
    found = boxes(4, 40)
    score = np.random.default_rng(5).random(40).round(1)
    kept = non_maximum_suppression(found, score, np.zeros(40, np.int64), 0.1)
    polygons = shapely.polygons(bev_corners(found))

    def iou(i: int, j: int) -> float:
        shared = polygons[i].intersection(polygons[j]).area
        return float(shared / (polygons[i].area + polygons[j].area - shared))

    assert all(iou(i, j) <= 0.1 for i in kept for j in kept if i < j)
    for gone in set(range(40)) - set(kept.tolist()):
        assert any(iou(gone, k) > 0.1 and score[k] >= score[gone] for k in kept)
    everyone = non_maximum_suppression(found, score, np.arange(40), 0.1)
    assert len(everyone) == 40

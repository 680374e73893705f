"""Figures whose values follow from the construction; the official packages are in tests/oracle."""

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.eval.paired import draw
from mottrack.eval.sceneflow.categories import CATEGORIES, GROUPS, category_numbers, group_table
from mottrack.eval.sceneflow.figures import SceneSums, differences
from mottrack.eval.sceneflow.points import FlowPoints
from mottrack.eval.sceneflow.sums import BUCKET_EDGES_M, frame_sums, total


def points_of(share: float, seed: int = 0, count: int = 500) -> FlowPoints:
    """Cars whose own motion is estimated as a share of the true one."""
    rng = np.random.default_rng(seed)
    ego_m = np.tile([0.5, 0.0, 0.0], (count, 1))
    own_m = rng.uniform(0.1, 1.9, (count, 1)) * np.array([[0.6, 0.8, 0.0]])
    dynamic = np.ones(count, bool)
    return FlowPoints(
        ego_m + own_m,
        ego_m + share * own_m,
        np.full(count, CATEGORIES.index("REGULAR_VEHICLE")),
        dynamic,
        dynamic,
        dynamic,
        dynamic,
        ego_m,
        rng.uniform(-30, 30, (count, 2)),
    )


@pytest.mark.parametrize(("share", "error"), [(1.0, 0.0), (0.0, 1.0), (0.75, 0.25), (2.0, 1.0)])
def test_dynamic_error_is_the_missing_share_of_the_speed(share: float, error: float) -> None:
    values = SceneSums((frame_sums(points_of(share)),)).values()
    assert values["bucketed", "CAR dynamic"] == pytest.approx(error, abs=1e-12)
    assert values["bucketed", "mean dynamic"] == pytest.approx(error, abs=1e-12)
    assert np.isnan(values["bucketed", "PEDESTRIAN dynamic"])
    strict = values["official", "Accuracy Strict/Foreground/Dynamic"]
    assert (strict == 1.0) == (error == 0.0)


def test_points_without_known_truth_do_not_count() -> None:
    wrong = points_of(0.0)
    half = np.arange(500) < 250
    mixed = replace(wrong, estimate_m=np.where(half[:, None], wrong.truth_m, 9e9), valid=half)
    values = SceneSums((frame_sums(mixed),)).values()
    assert values["official", "EPE/Foreground/Dynamic"] == 0.0


def test_files_without_positions_have_no_figure_by_speed() -> None:
    sums = SceneSums((frame_sums(replace(points_of(0.5), ego_motion_m=None, xy_m=None)),))
    assert {table for table, _ in sums.values()} == {"official", "moving regular_vehicle"}


def test_sums_of_parts_are_those_of_the_whole() -> None:
    parts = [points_of(0.5, seed) for seed in range(3)]
    columns = {
        name: np.concatenate([getattr(p, name) for p in parts])
        for name in FlowPoints.__dataclass_fields__
    }
    together, whole = total([frame_sums(p) for p in parts]), frame_sums(FlowPoints(**columns))
    np.testing.assert_allclose(together.official, whole.official, rtol=1e-12)
    np.testing.assert_allclose(together.buckets, whole.buckets, rtol=1e-12)


def test_paired_difference_of_methods_excludes_zero_only_where_they_differ() -> None:
    weights = draw(6, 200)
    better, worse, same = (
        SceneSums(tuple(frame_sums(points_of(share, seed)) for seed in range(6)))
        for share in (0.9, 0.6, 0.9)
    )
    found = {d.key: d for d in differences(worse.sampled(weights), better.sampled(weights))}
    best = next(d for k, d in found.items() if (k.row, k.metric) == ("bucketed", "mean dynamic"))
    assert best.better
    assert best.difference == pytest.approx(-0.3)
    assert not any(
        d.significant for d in differences(same.sampled(weights), better.sampled(weights))
    )


def test_categories_are_argoverses_in_its_order() -> None:
    assert len(CATEGORIES) == 31
    assert list(CATEGORIES[1:]) == sorted(CATEGORIES[1:])
    listed = [name for members in GROUPS.values() for name in members]
    assert len(set(listed)) == len(listed)
    assert set(listed) < set(CATEGORIES)
    assert (group_table() >= 0).sum() == len(listed)
    assert category_numbers(["van", "unheard of"]).tolist() == [19, -1]
    assert len(BUCKET_EDGES_M) == 52


def test_columns_of_another_length_are_refused() -> None:
    with pytest.raises(InputError, match="length of close"):
        replace(points_of(1.0), close=np.ones(3, bool))

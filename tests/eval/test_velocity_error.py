"""Velocity error by category, on rows whose error is known."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry.polygon import orient

from mottrack.core import SceneResult
from mottrack.eval.overlap import (
    NO_OBJECT,
    Outlines,
    TrueBoxes,
    best_overlaps,
    box_corners,
)
from mottrack.eval.velocity_error import (
    LEFT_OUT,
    ErrorRow,
    VelocityErrorConfig,
    VelocitySamples,
    match_by_overlap,
    velocity_samples,
    velocity_table,
)

Maker = Callable[[list[dict[str, Any]], int], SceneResult]


def pair(
    number: int, truth: tuple[float, float], track: tuple[float, float], **more: Any
) -> list[dict[str, Any]]:
    """A true box and a track on it, apart from all others."""
    place = {"frame": 0, "x": 20.0 * number, "id": number} | more
    return [
        place | {"side": "truth", "velocity": truth},
        {k: v for k, v in place.items() if k != "interpolated"}
        | {"side": "track", "velocity": track},
    ]


def test_every_row_of_the_table(make_result: Maker) -> None:
    rows = [
        *pair(0, (0.0, 0.0), (0.3, 0.4)),  # stands: error 0.5
        *pair(1, (1.0, 0.0), (1.0, 2.0), label="pedestrian"),  # slow: 2
        *pair(2, (3.0, 0.0), (3.0, 1.0)),  # at the border, in both: 1
        *pair(3, (10.0, 0.0), (6.0, 3.0), label="cyclist"),  # fast: 5
        *pair(4, (9.0, 0.0), (0.0, 0.0), interpolated=True),  # left out
        {"side": "track", "frame": 0, "id": 9, "x": -50.0, "velocity": (0.0, 0.6)},  # a fence
    ]
    table = velocity_table([velocity_samples(make_result(rows, 1))])
    figures = {name: (row.count, round(row.mean_mps, 9)) for name, row in table.items()}
    assert figures == {
        "unlabelled tracks (assumed static)": (1, 0.6),
        "pedestrian & cyclist": (2, 3.5),
        "objects observed stationary": (1, 0.5),
        "slow (0, 3] m/s": (2, 1.5),
        "fast [3, inf) m/s": (2, 3.0),
        "all": (5, 1.82),
        "car": (2, 0.75),
        "cyclist": (1, 5.0),
        "pedestrian": (1, 2.0),
    }


def test_hull_decides_before_box_and_overlap_is_a_share_of_it(make_result: Maker) -> None:
    truth = {"side": "truth", "frame": 0, "id": 1, "x": 0.0, "velocity": (5.0, 0.0)}
    inside = [(1.0, -0.5), (1.8, -0.5), (1.8, 0.5)]
    outside = [(1.0, 2.0), (1.8, 2.0), (1.8, 3.0)]
    half = [(1.0, 0.0), (3.0, 0.0), (3.0, 0.5), (1.0, 0.5)]
    tracks = [
        {"side": "track", "frame": 0, "id": k, "x": 0.0, "hull": hull}
        for k, hull in enumerate((inside, outside, half))
    ]
    result = make_result([truth, *tracks], 1)
    assert match_by_overlap(result, 0.5).tolist() == [0, NO_OBJECT, 0]
    assert match_by_overlap(result, 0.51).tolist() == [0, NO_OBJECT, NO_OBJECT]


def test_coasting_and_interpolated_rows(make_result: Maker) -> None:
    rows = pair(0, (2.0, 0.0), (0.0, 0.0)) + pair(1, (2.0, 0.0), (0.0, 0.0), interpolated=True)
    rows[1]["observed"] = False
    result = make_result(rows, 1)
    assert match_by_overlap(result, 0.5).tolist() == [0, LEFT_OUT]
    assert len(velocity_samples(result).error_mps) == 0
    counted = velocity_samples(result, VelocityErrorConfig(coasting=True))
    assert counted.error_mps.tolist() == [2.0]


def row_of(error_mps: np.ndarray) -> ErrorRow:
    samples = VelocitySamples(error_mps, 0.0 * error_mps, np.full(len(error_mps), "car"))
    return velocity_table([samples])["all"]


def test_upper_tail_is_given_in_both_readings() -> None:
    row = row_of(np.arange(1.0, 101.0))
    assert (row.count, row.mean_mps, row.median_mps) == (100, 50.5, 50.5)
    assert row.worst_mean_mps == pytest.approx(98.0)
    assert row.percentile_95_mps == pytest.approx(95.05)
    assert np.isnan(row_of(np.zeros(0)).mean_mps)
    assert row_of(np.array([3.0])).worst_mean_mps == 3.0


def test_no_truth_and_no_tracks(make_result: Maker) -> None:
    alone = make_result([{"side": "track", "frame": 0, "id": 1, "x": 0.0}], 1)
    table = velocity_table([velocity_samples(alone)])
    assert table["unlabelled tracks (assumed static)"].count == 1
    assert table["all"].mean_mps == 0.0
    truth_only = make_result([{"side": "truth", "frame": 0, "id": 1, "x": 0.0}], 1)
    assert velocity_table([velocity_samples(truth_only)])["all"].count == 0
    assert velocity_table([])["all"].count == 0


@pytest.mark.parametrize("behind_m", [1.6, -1.6])
def test_a_cluster_may_be_a_revolution_older_or_younger_than_the_stamp(
    make_result: Maker, behind_m: float
) -> None:
    truth = {"side": "truth", "frame": 0, "id": 1, "x": 0.0, "velocity": (20.0, 0.0)}
    ends = (2.3 - behind_m, 0.3 - behind_m) if behind_m < 0 else (-0.3 - behind_m, -2.3 - behind_m)
    hull = [(ends[0], -0.5), (ends[0], 0.5), (ends[1], 0.5), (ends[1], -0.5)]
    result = make_result([truth, {**truth, "side": "track", "hull": hull}], 1)
    assert match_by_overlap(result, 0.5, revolution_s=0.1).tolist() == [0]
    assert match_by_overlap(result, 0.5, revolution_s=0.0).tolist() == [NO_OBJECT]


def convex(rng: np.random.Generator) -> np.ndarray:
    points = rng.normal(0.0, 1.5, (rng.integers(3, 9), 2)) + rng.uniform(-4.0, 4.0, 2)
    hull = orient(shapely.convex_hull(shapely.MultiPoint(points)))
    return np.array(hull.exterior.coords)[:-1]


@pytest.mark.parametrize("far_m", [0.0, 4e6])
def test_matches_are_those_of_shapely(far_m: float) -> None:
    """Hulls, boxes that stand and that move, over three frames, far from the origin too."""
    rng = np.random.default_rng(7)
    outlines = [convex(rng) + far_m for _ in range(150)]
    frame, true_frame = np.sort(rng.integers(0, 3, 150)), np.sort(rng.integers(0, 3, 60))
    centre_m, size_m = rng.uniform(-4.0, 4.0, (60, 2)) + far_m, rng.uniform(0.5, 5.0, (60, 2))
    shift_m = rng.normal(0.0, 1.0, (60, 2)) * (rng.random((60, 1)) < 0.5)
    corners = box_corners(centre_m, size_m, rng.uniform(-4.0, 4.0, 60))
    start = np.cumsum([0, *map(len, outlines)])
    found = best_overlaps(
        Outlines(np.concatenate(outlines), start, frame),
        TrueBoxes(corners, true_frame, shift_m),
        0.5,
    )
    expected = []
    for outline, at in zip(outlines, frame, strict=True):
        own, answer = shapely.Polygon(outline - far_m), NO_OBJECT
        for age in (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0):
            boxes = shapely.polygons(corners - far_m - age * shift_m[:, None])
            share = shapely.area(shapely.intersection(own, boxes)) / own.area
            share[true_frame != at] = 0.0
            if share.max() >= 0.5:
                answer = int(share.argmax())
                break
        expected.append(answer)
    assert found.tolist() == expected
    assert 20 < np.count_nonzero(found != NO_OBJECT) < 140

"""Region of interest: hand counts, and what the configuration refuses."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from mottrack.core import FlowSamples, SceneResult
from mottrack.eval.evaluation import score
from mottrack.eval.region import Region
from mottrack.eval.scores import ScoreConfig

Maker = Callable[[list[dict[str, Any]], int], SceneResult]
SQUARE = [[0.0, -5.0], [20.0, -5.0], [20.0, 5.0], [0.0, 5.0]]


def scene(make_result: Maker) -> SceneResult:
    """Two frames: objects at x = -10, 10 and 30 m, tracks on the first two, one false at 15 m."""
    rows: list[dict[str, Any]] = []
    for frame in range(2):
        for number, x in enumerate((-10.0, 10.0, 30.0)):
            box = {"frame": frame, "id": number, "x": x, "velocity": (1.0, 0.0)}
            rows.append(box | {"side": "truth"})
            if x < 20.0:
                rows.append(box | {"side": "track"})
        rows.append({"side": "track", "frame": frame, "id": 9, "x": 15.0, "y": 4.0})
    result = make_result(rows, 2)
    flow = FlowSamples(
        frame=np.array([0, 0, 1]),
        xy_m=np.array([[-10.0, 0.0], [10.0, 0.0], [30.0, 0.0]], np.float32),
        estimate_mps=np.zeros((3, 2), np.float32),
        truth_mps=np.zeros((3, 2), np.float32),
        dt_s=np.full(3, 0.1, np.float32),
        valid=np.ones(3, bool),
        dynamic=np.zeros(3, bool),
        movable=np.zeros(3, bool),
        observable=np.ones(3, bool),
    )
    return replace(result, flow=flow)


@pytest.mark.parametrize(
    ("region", "truth", "matches", "false_positives", "cells"),
    [
        (None, 6, 4, 2, 3),
        ({"max_range_m": 20.0}, 4, 4, 2, 2),
        ({"max_range_m": 10.0}, 0, 0, 0, 0),  # the far border is outside, the near one inside
        ({"min_range_m": 10.0, "max_range_m": 12.0}, 4, 4, 0, 2),
        ({"polygon": SQUARE}, 2, 2, 2, 1),
        ({"polygon": [*SQUARE, SQUARE[0]]}, 2, 2, 2, 1),
        ({"polygon": SQUARE, "max_range_m": 12.0}, 2, 2, 0, 1),
        ({"polygon": [[10.0, -1.0], [40.0, -1.0], [40.0, 1.0], [10.0, 1.0]]}, 4, 2, 0, 2),
    ],
)
def test_counts_within_a_region(
    make_result: Maker,
    region: dict[str, Any] | None,
    truth: int,
    matches: int,
    false_positives: int,
    cells: int,
) -> None:
    config = ScoreConfig.model_validate({"region": region, "min_score": 0.0})
    scores = score([scene(make_result)], config)
    clear = scores.overall.clear
    assert (clear.truth, clear.matches, clear.false_positives) == (truth, matches, false_positives)
    assert sum(scores.flow[k].cells for k in ("dynamic", "static") if scores.flow) == cells
    assert scores.velocity["all"].count == matches + false_positives


def test_a_polygon_of_the_vehicle_moves_with_it_and_one_of_the_world_stands(
    make_result: Maker,
) -> None:
    still = scene(make_result)
    poses = still.frames.world_T_ego.copy()
    poses[1, :2, :2] = [[0.0, -1.0], [1.0, 0.0]]  # the second frame looks along +y
    turned = replace(still, frames=replace(still.frames, world_T_ego=poses))
    ego = Region(polygon=SQUARE).crop(turned)
    world = Region(polygon=SQUARE, frame="world").crop(turned)
    assert ego.truth.frame.tolist() == [0]
    assert world.truth.frame.tolist() == [0, 1]
    assert ego.flow.frame.tolist() == [0]
    assert Region(polygon=SQUARE).crop(still).truth.frame.tolist() == [0, 1]


def test_a_track_at_the_border_keeps_its_object_for_the_velocity_error(make_result: Maker) -> None:
    box = {"frame": 0, "id": 1, "velocity": (5.0, 0.0)}
    rows = [box | {"side": "truth", "x": 20.1}, box | {"side": "track", "x": 19.9}]
    scores = score([make_result(rows, 1)], ScoreConfig(region=Region(max_range_m=20.0)))
    assert scores.overall.clear.truth == 0
    assert scores.velocity["all"].mean_mps == 0.0
    assert scores.velocity["fast [3, inf) m/s"].count == 1


def test_hulls_stay_with_their_tracks(make_result: Maker) -> None:
    hull = [(9.0, -1.0), (11.0, -1.0), (10.0, 1.0)]
    rows = [
        {"side": "track", "frame": 0, "id": 1, "x": -10.0, "hull": [(-9, 0), (-8, 0), (-8, 1)]},
        {"side": "track", "frame": 0, "id": 2, "x": 10.0, "hull": hull},
    ]
    (kept,) = Region(polygon=SQUARE).crop(make_result(rows, 1)).hulls
    assert kept.tolist() == [list(corner) for corner in hull]


@pytest.mark.parametrize(
    ("region", "complaint"),
    [
        ({"min_range_m": 5.0, "max_range_m": 5.0}, "max_range_m is 5, expected more than"),
        ({"min_range_m": -1.0}, "greater than or equal to 0"),
        ({"polygon": [[0.0, 0.0], [1.0, 0.0]]}, "2 different vertices, expected at least 3"),
        ({"polygon": [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]}, "polygon is not simple"),
        ({"polygon": [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]}, "polygon is not simple"),
        ({"polygon": SQUARE, "frame": "map"}, "'ego' or 'world'"),
        ({"radius_m": 5.0}, "Extra inputs are not permitted"),
    ],
)
def test_what_is_no_region_is_refused(region: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        Region.model_validate(region)

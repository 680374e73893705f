"""The scores of a run, from stored results to the numbers of scores.json."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mottrack.core import SceneResult
from mottrack.eval.evaluation import score
from mottrack.eval.scores import ScoreConfig

Maker = Callable[[list[dict[str, Any]], int], SceneResult]


def rows(shift: float = 0.3, **track: Any) -> list[dict[str, Any]]:
    out = []
    for frame in range(6):
        for k, label in enumerate(("car", "pedestrian")):
            box = {"frame": frame, "id": k, "x": 10.0 * k + frame, "label": label}
            box |= {"velocity": (2.0, 0.0), "size": (4.0, 2.0, 1.5)}
            out.append(box | {"side": "truth"})
            out.append(box | {"side": "track", "x": box["x"] + shift, "id": k + 5} | track)
    return out


def test_all_figures_are_there_and_strict_json(make_result: Maker) -> None:
    figures = score([make_result(rows(), 6)] * 2).as_dict()
    text = json.dumps(figures, allow_nan=False)
    assert set(json.loads(text)["classes"]) == {"car", "pedestrian"}
    overall = figures["overall"]
    assert (overall["mota"], overall["idf1"], overall["amota"]) == (1.0, 1.0, 1.0)
    assert overall["motp_m"] == pytest.approx(0.3)
    assert overall["truth_boxes"] == 24
    assert overall["id_switches"] == 0
    assert figures["velocity_error"]["slow (0, 3] m/s"]["count"] == 24
    assert figures["flow_error"] == {}


def test_boxes_match_by_distance_or_by_overlap(make_result: Maker) -> None:
    apart = make_result(rows(shift=1.9), 6)
    assert score([apart]).overall.clear.mota == 1.0
    by_overlap = score([apart], ScoreConfig(match_by="iou", match_iou=0.5))
    assert by_overlap.overall.clear.mota == -1.0
    looser = score([apart], ScoreConfig(match_by="iou", match_iou=0.3)).overall.clear
    assert looser.motp == pytest.approx(1 - 2.1 / 5.9)


def test_motp_has_the_name_of_its_measure(make_result: Maker) -> None:
    result = make_result(rows(shift=1.9), 6)
    by_distance = score([result]).overall.as_dict()
    by_iou = score([result], ScoreConfig(match_by="iou")).overall.as_dict()
    assert by_distance["motp_m"] == pytest.approx(1.9)
    assert np.isnan(by_distance["motp_iou_distance"])
    assert by_iou["motp_iou_distance"] == pytest.approx(1 - 2.1 / 5.9)
    assert np.isnan(by_iou["motp_m"])


@pytest.mark.parametrize("far_m", [2e4, 4e6])
def test_scores_are_the_same_in_map_coordinates(make_result: Maker, far_m: float) -> None:
    near = make_result(rows(shift=0.31), 6)  # its similarity is no threshold of HOTA
    shift = far_m * np.array([1.0, -1.0, 0.0])
    world_T_ego = near.frames.world_T_ego.copy()
    world_T_ego[:, :3, 3] += shift
    far = replace(
        near,
        frames=replace(near.frames, world_T_ego=world_T_ego),
        truth=replace(near.truth, centre_m=near.truth.centre_m + shift),
        tracks=replace(near.tracks, centre_m=near.tracks.centre_m + shift),
    )
    for config in (ScoreConfig(), ScoreConfig(match_by="iou")):
        expected = score([near], config).overall.as_dict()
        assert score([far], config).overall.as_dict() == pytest.approx(
            expected, abs=1e-8, nan_ok=True
        )


def test_clusters_are_matched_whatever_their_class(make_result: Maker) -> None:
    generic = make_result(rows(label="generic"), 6)
    scores = score([generic])
    assert scores.overall.clear.mota == 1.0
    assert scores.as_dict()["overall"]["amota"] is None

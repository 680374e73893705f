"""The fast reader: what the reader of single boxes makes of a file, or nothing at all."""

import copy
import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mottrack.eval.nuscenes.bodies import to_bodies
from mottrack.eval.nuscenes.boxes import Samples
from mottrack.eval.nuscenes.clean_submission import read_clean
from mottrack.eval.nuscenes.groundtruth import read_ground_truth
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.submission import read_submission, to_boxes
from mottrack.eval.nuscenes.submission_checks import validate
from mottrack.formats.nuscenes_splits import resolve_split

Content = dict[str, Any]


def samples() -> Samples:
    return Samples(
        scene_name=np.array(["a", "b"]),
        first=np.array([0, 2, 4]),
        token=np.array(["t0", "t1", "t2", "t3"]),
        stamp_us=np.arange(4) * 500_000,
        ego_xy_m=np.full((4, 2), 800.0),
    )


def box(token: str, identity: str, **changes: Any) -> Content:
    plain = {
        "sample_token": token,
        "translation": [801.5, 799, 1e0],
        "size": [1.9, 4.5, 1.6],
        "rotation": [1.0, 0.0, 0.0, 0.0],
        "velocity": [0.1, -2],
        "tracking_id": identity,
        "tracking_name": "car",
        "tracking_score": 0.7310585786300049,
    }
    return plain | changes


def content() -> Content:
    results = {
        "t0": [box("t0", "7"), box("t0", "a ü")],
        "t1": [],
        "t2": [box("t2", "7", tracking_name="bus", attribute="x")],
        "t3": [],
    }
    return {"meta": {"use_lidar": True, "note": ["]", "}"]}, "results": results}


def read(path: Path, text: str) -> Any:
    path.write_text(text)
    return read_clean(path, samples(), Rules())


def assert_as_single_boxes(path: Path, among: Samples) -> None:
    clean = read_clean(path, among, Rules())
    assert clean is not None
    slow = read_submission(path)
    assert validate(slow, among, Rules()) == []
    assert clean.meta == slow.meta
    boxes = to_boxes(slow, among, Rules())
    bodies = to_bodies(slow, boxes, Rules())
    for table, same in ((clean.boxes, boxes), (clean.bodies, bodies)):
        for column in fields(same):
            np.testing.assert_array_equal(
                getattr(table, column.name), getattr(same, column.name), column.name
            )


@pytest.mark.parametrize("indent", [None, 1])
@pytest.mark.parametrize("separators", [(",", ":"), (", ", ": ")])
@pytest.mark.parametrize("order", [("meta", "results"), ("results", "meta")])
def test_every_layout_is_read(
    indent: int | None, separators: tuple[str, str], order: tuple[str, str], tmp_path: Path
) -> None:
    path, whole = tmp_path / "s.json", content()
    whole = {name: whole[name] for name in order}
    if order[0] == "results":
        whole["results"] = dict(reversed(whole["results"].items()))
    path.write_text(json.dumps(whole, indent=indent, separators=separators))
    assert_as_single_boxes(path, samples())


def edit(change: Callable[[Content], Any]) -> str:
    whole = copy.deepcopy(content())
    change(whole)
    return json.dumps(whole)


def set_box(**values: Any) -> str:
    return edit(lambda c: c["results"]["t0"][1].update(values))


def without(name: str) -> str:
    return edit(lambda c: c["results"]["t0"][0].pop(name))


FAULTS = {
    "NaN": set_box(tracking_score=float("nan")),
    "infinite": set_box(velocity=[float("inf"), 0.0]),
    "no score": without("tracking_score"),
    "no velocity": without("velocity"),
    "no identity": without("tracking_id"),
    "no class": without("tracking_name"),
    "score above 1": set_box(tracking_score=1.5),
    "score as text": set_box(tracking_score="0.5"),
    "short vector": set_box(translation=[1.0, 2.0]),
    "null in a vector": set_box(size=[1.0, None, 1.0]),
    "flat": set_box(size=[1.0, 0.0, 1.0]),
    "out of the world": set_box(translation=[1e9, 0.0, 0.0]),
    "larger than anything": set_box(size=[1e6, 1.0, 1.0]),
    "no quaternion": set_box(rotation=[2.0, 0.0, 0.0, 0.0]),
    "unknown class": set_box(tracking_name="cart"),
    "identity twice": set_box(tracking_id="7"),
    "points": set_box(num_pts=0),
    "of another sample": set_box(sample_token="t1"),  # noqa: S106
    "number as identity": set_box(tracking_id=7),
    "class changes": edit(lambda c: c["results"].update(t1=[box("t1", "7", tracking_name="bus")])),
    "missing sample": edit(lambda c: c["results"].pop("t3")),
    "unknown sample": edit(lambda c: c["results"].update(t9=[])),
    "too many": edit(lambda c: c["results"].update(t3=[box("t3", str(i)) for i in range(501)])),
    "no list": edit(lambda c: c["results"].update(t3={})),
    "a box is no object": edit(lambda c: c["results"]["t3"].append(3)),
    "ego frame": edit(
        lambda c: [b.update(translation=[3.0, 1.0, 0.0]) for v in c["results"].values() for b in v]
    ),
    "no box": edit(lambda c: c.update(results={f"t{i}": [] for i in range(4)})),
    "no meta": edit(lambda c: c.pop("meta")),
    "more keys": edit(lambda c: c.update(more=1)),
    "cut": json.dumps(content())[:-30],
    "followed by more": json.dumps(content()) + "{}",
    "sample twice": json.dumps(content())[:-2] + ', "t0": []}}',
    "results twice": json.dumps(content())[:-1] + ', "results": {}}',
    "results within meta": '{"meta": {"results": {}}, "results": {}}',
    "brackets in a text": set_box(tracking_id="}, {"),
    "an end in a text": set_box(tracking_id='}], "t1": [{'),
    "key twice": json.dumps(content()).replace('"size"', '"rotation": [0], "size"', 1),
    "a comma missing": json.dumps(content()).replace("}, {", "} {", 1),
    "a colon missing": json.dumps(content()).replace('"t0": ', '"t0" ', 1),
    "empty file": "",
    "no object": "[]",
}


@pytest.mark.parametrize("name", FAULTS)
def test_nothing_is_made_of_a_file_with_any_fault(name: str, tmp_path: Path) -> None:
    assert read(tmp_path / "s.json", FAULTS[name]) is None


def test_recorded_submissions_are_read_alike(golden: dict[str, Any]) -> None:
    clean = 0
    for one in golden.values():
        names = resolve_split(str(one.scenes))
        truth = read_ground_truth(one.data, "v1.0-trainval", names, Rules())
        path = one.data / "submission.json"
        if read_clean(path, truth.samples, Rules()) is not None:
            assert_as_single_boxes(path, truth.samples)
            clean += 1
    assert clean >= 4

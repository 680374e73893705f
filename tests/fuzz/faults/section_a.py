"""A: faults that were once wrong and silent."""

# ruff: noqa: S106 - tokens of records

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mottrack import Objects, Pipeline, Pose
from mottrack.core.checks import as_array
from mottrack.datasets.check import check_dataset
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import write_synthetic
from mottrack.eval.mot import score_files
from mottrack.pipeline.measured_flow import MeasuredFlow
from mottrack.trackers import KalmanTracker
from tests.datasets import ros_log
from tests.datasets.makers import SEED, open_dataset
from tests.datasets.test_own_logs import cloud, padded_cloud
from tests.fuzz.faults.finished import edited
from tests.fuzz.faults.printed import (
    Faults,
    Printed,
    changed,
    checked,
    command,
    copied,
    every_box,
    experiment,
    fed,
    file_of,
    frame,
    microseconds,
    popped,
    raised,
    record,
    replaced,
    rows,
    through_float,
)
from tests.fuzz.targets import TARGETS

EVALUATION = (
    *(
        "eval",
        "nuscenes",
        "--dataroot",
        "{root}/nuscenes",
        "--submission",
        "{root}/submission.json",
    ),
    *("--split", "{root}/s.txt", "--no-picture", "--out", "{root}/out"),
)
ANNOTATIONS = "nuscenes annotations"


def evaluated(name: str, **fields: object) -> Printed:
    """What `eval nuscenes` says when the first record of a table has other fields, or is twice."""

    def edit(root: Path) -> str:
        file = file_of(root, TARGETS[name])
        data = file.read_bytes()
        content = json.loads(data)
        content[0].update(fields)
        content += content[:1] if not fields else []
        file.write_text(json.dumps(content))
        try:
            return command(*EVALUATION, word="mottrack:")(root)
        finally:
            file.write_bytes(data)

    return edit


def columns_of_truth(root: Path) -> str:
    """The class column is read from 8, 9 and 10 columns alike."""
    found = []
    for more in ([], [1.0], [1.0, 0.0]):
        kinds = {1: 1, 2: 7}
        lines = [[f, i, 10 * i, 9, 30, 60, 1, kinds[i], *more] for f in (1, 2) for i in (1, 2)]
        for name, kept in (("gt", 8 + len(more)), ("tracks", 6)):
            text = "\n".join(",".join(map(str, line[:kept])) for line in lines)
            (root / f"{name}.txt").write_text(text + "\n")
        found.append(score_files(root / "gt.txt", root / "tracks.txt").scores.clear.truth)
    return f"boxes of class 1 with 8, 9, 10 columns: {found}, of 2 and 2 of class 7"


def padded_rows(root: Path) -> str:
    """An organised cloud whose rows are longer than their points."""
    folder = root / "padded"
    folder.mkdir()
    points = {10**9: padded_cloud(10**9, 1664, 64)}
    poses = {stamp: ros_log.odometry(stamp, Pose.identity()) for stamp in (10**9, 11 * 10**8)}
    ros_log.write_messages(folder / "log.mcap", {"/points": points, "/odometry": poses})
    found = open_dataset("ros", folder, detections_topic=None, truth_topic=None)
    right = np.isclose(found.scene("log").sweep(0).xyz_m, cloud(0), atol=1e-5).all(axis=1)
    return f"{right.sum()} of {len(cloud(0))} points in their place"


def in_ego_frame(folder: Path) -> None:
    """Move the world, as far as a map's origin lies from a road, but not the detections."""
    for name in ("ego_pose", "sample_annotation"):
        file = folder / f"v1.0-trainval/{name}.json"
        records = json.loads(file.read_text())
        for one in records:
            one["translation"][0] += 900.0
        file.write_text(json.dumps(records))


def in_reverse(root: Path) -> str:
    """Two seconds of a drive, whose poses are in reverse."""
    world = SyntheticConfig(scenes=1, seed=SEED, duration_s=2.0)
    write_synthetic(root / "reversed", "kitti", world)
    poses = root / "reversed/training/poses/0000.txt"
    poses.write_text("\n".join(reversed(poses.read_text().splitlines())) + "\n")
    lines = check_dataset(open_dataset("kitti", root / "reversed"), every=100, workers=1).lines()
    return "\n".join(line for line in lines if "warning" in line)


def all_microseconds(folder: Path) -> None:
    for path in folder.glob("log/*.csv"):
        path.write_text("\n".join(microseconds(path.read_text().splitlines())) + "\n")
    for path in folder.glob("log/sweeps/*"):
        path.rename(path.with_name(f"{int(path.stem) // 1000}{path.suffix}"))


def never_measured(_root: Path) -> str:
    pipeline = Pipeline.from_config("demo", "flow=zero")
    watch = MeasuredFlow()
    for k in range(12):
        watch.add(pipeline.feed(**frame(k)))
    return "; ".join(f"warning: {concern}" for concern in watch.concerns())


def folder_for_file(root: Path) -> object:
    with copied(root, "kitti") as folder:
        labels = folder / "training/label_02/0000.txt"
        labels.unlink()
        labels.mkdir()
        return TARGETS["kitti labels"].read(root / "copy")


def no_height(lines: list[str]) -> list[str]:
    return [" ".join([*(r := line.split())[:6], "0", "0", "0", "0", *r[10:]]) for line in lines]


class Nothing:
    """A tracker without a result."""

    def step(self, stamp_ns: int, objects: Objects) -> None:
        del stamp_ns, objects

    def reset(self) -> None: ...

    def finish(self, steps: list[object]) -> list[object]:
        return steps


def stepped(_root: Path) -> object:
    return KalmanTracker().step(400_000_000, Objects.empty(700_000_000))


ICP = ("flow=cluster_icp",)
FAULTS: Faults = {
    "A1 Argoverse 2 detections whose stamps went through float64": changed(
        "argoverse2 detections", through_float
    ),
    "A2 MOT text with an empty cell": rows(
        "mot tracks", lambda r: [",".join([*r[0].split(",")[:6], "", "-1,-1,-1"]), *r[1:]]
    ),
    "A3 MOT truth with 8 or 10 columns": raised(columns_of_truth),
    "A4 KITTI results with one id twice in a frame": rows(
        "kitti eval tracks", lambda r: [*r, r[0]]
    ),
    "A4 KITTI labels with a row twice": rows("kitti eval labels", lambda r: [*r, r[0]]),
    "A4 MOT tracks with one id twice in a frame": rows("mot tracks", lambda r: [*r, r[0]]),
    "A5 `row_step` larger than width x point_step": raised(padded_rows),
    "A6 quaternions as x, y, z, w": every_box(
        "nuscenes detections",
        lambda b: b.update(rotation=[*b["rotation"][1:], b["rotation"][0]]),
    ),
    "A6 boxes in the ego frame given as global": checked("nuscenes", in_ego_frame, "far from"),
    "A6 stamps in microseconds, all files": checked("folder", all_microseconds, "time steps"),
    "A6 stamps in microseconds, one file": rows("own poses", microseconds),
    "A6 a flow source that never measures": never_measured,
    "A7 `eval nuscenes`: a submission's sample_token is of no sample": record(
        "nuscenes submission", sample_token="x"
    ),
    "A7 an annotation of `sample_token: x`": evaluated(ANNOTATIONS, sample_token="x"),
    "A7 a record twice": evaluated(ANNOTATIONS),
    "A7 a translation of text": evaluated(ANNOTATIONS, translation=["1", "2", "3"]),
    "A7 a translation of 1e300": evaluated(ANNOTATIONS, translation=[1e300, 0, 0]),
    "A7 two key frames for a sample": changed(
        "nuscenes sample_data",
        lambda data: json.dumps([{**r, "is_key_frame": True} for r in json.loads(data)]).encode(),
    ),
    "A7 an unknown category": evaluated("nuscenes instance", category_token="x"),
    "A7 a null time": evaluated("nuscenes sample", timestamp=None),
    "A8 a token that points nowhere": record("nuscenes sample_data", ego_pose_token="x"),
    "A8 an annotation removed": popped(ANNOTATIONS),
    "A8 a sample removed": popped("nuscenes sample"),
    "A8 a sweep removed": popped("nuscenes sample_data"),
    "A9 an experiment of 0 bytes": experiment(""),
    "A9 an experiment of null": experiment("null"),
    "A9 an experiment of {}": experiment("{}"),
    "A9 `config.yaml` of a run folder edited afterwards": edited,
    "A10 labels of a folder log as `Car`": replaced("own detections", ",car,", ",Car,", 999),
    "A10 types of KITTI results as `car`, read as Car": replaced(
        "kitti eval tracks", "Car", "car", 999
    ),
    "A10 type `2`": replaced("kitti eval tracks", "Car", "2", 999),
    "A10 id -1": rows(
        "kitti eval tracks", lambda r: [" ".join([x.split()[0], "-1", *x.split()[2:]]) for x in r]
    ),
    "A10 2-D boxes of zeros": rows("kitti eval tracks", no_height),
    'A10 ids 3 and "3" in one track': record("nuscenes submission", tracking_id=3),
    "A11 a detection twice": rows("own detections", lambda r: [*r, r[-1]]),
    "A11 a decimal comma": rows(
        "own detections", lambda r: [r[0], r[1].replace(".", ",", 1), *r[2:]]
    ),
    "A11 digits with underscores": rows("own poses", lambda r: [r[0], f"1_{r[1]}", *r[2:]]),
    "A11 a label file that is a folder": raised(folder_for_file),
    "A11 KITTI poses in reverse": in_reverse,
    "A11 more poses than frames": rows("kitti poses", lambda r: [*r, *r]),
    "A11 map heights of inf": changed("argoverse2 heights", lambda d: d[:-4] + b"\0\0\x80\x7f"),
    "A12 a tracker whose `step` returns None": fed(
        ("flow=zero", "tracker=tests.fuzz.faults.section_a:Nothing"), frame(1)
    ),
    "A13 `KalmanTracker.step` with objects of another stamp": raised(stepped),
    "A13 masked arrays": fed(ICP, frame(1, points=np.ma.masked_equal([[1.0, 2.0, 3.0]], 2.0))),
    'A13 `valid=["True", "False"]`': raised(
        lambda _: as_array("valid", ["True", "False"], np.bool_, (None,))
    ),
}

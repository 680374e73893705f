"""Every format that is read: a small file of it, how to read it, and how to damage it."""

# ruff: noqa: S106 - tokens of records, not of people

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core import Dataset, Pose, SceneResult, TruthTable
from mottrack.core.concerns import Concern
from mottrack.core.scene_objects import SceneObjects, load_objects, save_objects
from mottrack.core.sweep import SECOND_NS
from mottrack.core.tables import FrameTable, TrackTable
from mottrack.datasets.argoverse2.ground_height import read_ground_height
from mottrack.datasets.plausibility.watch import SceneWatch
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.datasets.table_tracks import table_tracks
from mottrack.eval.kitti.files import Folders, evaluate_folders
from mottrack.eval.kitti.matching import KittiRules
from mottrack.eval.mot import score_files
from mottrack.eval.nuscenes import command
from mottrack.eval.sceneflow.stored import empty_sums, load_sums, save_sums
from mottrack.formats.box_table import read_box_rows, write_box_rows
from mottrack.formats.detector_exports import read_export
from tests.datasets.makers import SEED, open_dataset, write_own_log
from tests.fuzz.damage import (
    Arrow,
    Damage,
    Floats,
    Records,
    Results,
    TextRows,
    cut,
    empty,
    flip,
    garbage,
    npy_damages,
    npz_damages,
    zeros,
)

Values = list[Any]


@dataclass
class Read:
    """What a reader made of a file: arrays to compare, and what it warned of."""

    values: Values
    warnings: list[object] = field(default_factory=list)


@dataclass(frozen=True)
class Target:
    """One file of a format.

    path: under the root of the small data sets.
    read: reads the file, or the data set that it belongs to.
    damages: by name.
    """

    path: str
    read: Callable[[Path], Read]
    damages: dict[str, Damage]


def never(_data: bytes) -> bool:
    return False


def always(_data: bytes) -> bool:
    """Of a text whose end says nothing that is needed."""
    return True


def after_points(row_bytes: int) -> Callable[[bytes], bool]:
    return lambda data: len(data) > 0 and len(data) % row_bytes == 0


def in_last_value(
    columns: int, separator: str | None = None, fewest: int = 0
) -> Callable[[bytes], bool]:
    """The cut fell between two lines or inside the last value of one.

    Where rows may have as few as `fewest` values, nothing says of a single row how many it had.
    """

    def whole(data: bytes) -> bool:
        lines = data.decode().splitlines() or [""]
        needed = fewest if fewest and len(lines) == 1 else columns
        return len(lines[-1].split(separator)) >= needed

    return whole


def common(whole_at: Callable[[bytes], bool], *, may_be_empty: bool = False) -> dict[str, Damage]:
    found: dict[str, Damage] = {"cut": cut(whole_at), "flip": flip, "garbage": garbage}
    return found | {"zeros": zeros} | ({} if may_be_empty else {"empty": empty})


# --- reading -------------------------------------------------------------------------------------


def dataset_of(kind: str) -> Callable[[Path], Dataset]:
    return lambda root: open_dataset(kind, root / kind)


def read_scene(
    kind: str, *, sweeps: bool = False, folder: str = "", **settings: object
) -> Callable[[Path], Read]:
    """Poses, boxes and labels of the first scene, its sweeps only on request."""

    def read(root: Path) -> Read:
        dataset = open_dataset(kind, root / (folder or kind), **settings)
        scene = dataset.scene(dataset.scene_names[0])
        watch = SceneWatch(scene)
        values: Values = [scene.has_sweeps]
        for index in range(len(scene)):
            frame = scene.frame(index)
            values += [frame.stamp_ns, frame.is_key, frame.world_T_ego.matrix]
            for boxes in (frame.truth, frame.detections):
                if boxes is not None:
                    values += [boxes.centre_m, boxes.size_m, boxes.yaw_rad, boxes.label]
            sweep = scene.sweep(index) if sweeps else None
            watch.add_unseen(frame, sweep)
            if sweep is not None:
                values += [sweep.xyz_m, sweep.reflectance]
        return Read(values, list(watch.concerns()))

    return read


def bag_reader(folder: str, topic: str | None = "/detections") -> Callable[[Path], Read]:
    topics = {"detections_topic": topic, "truth_topic": None}
    return read_scene("ros", sweeps=True, folder=folder, **topics)


def read_ground(root: Path) -> Read:
    ground = read_ground_height(root / "map")
    assert ground is not None
    return Read([ground.height_m, ground.rotation, ground.translation, ground.scale])


def read_mot(root: Path) -> Read:
    scored = score_files(root / "mot/gt.txt", root / "mot/tracks.txt")
    return Read([list(scored.scores.as_dict().values())], list(scored.concerns))


def read_kitti(root: Path) -> Read:
    folders = Folders(root / "eval_kitti/labels", root / "eval_kitti/tracks", ("0000",))
    found = evaluate_folders(folders, KittiRules())
    row = found.metrics.as_dict()
    figures = [row["amota"], row["fp"], *found.identity["all tracks"].as_dict().values()]
    return Read(figures, list(found.concerns))


def read_table(name: str) -> Callable[[Path], Read]:
    """Tracks of a csv or Parquet table."""
    stamps = tuple(range(0, 5 * SECOND_NS, SECOND_NS))
    frames = SceneFrames("s", tuple((str(t),) for t in stamps), stamps, (Pose.identity(),) * 5)

    def read(root: Path) -> Read:
        rows = read_box_rows(root / "tables" / name, tracks=True)
        found = table_tracks(rows, frames, "world")
        if found is None:
            return Read([None])
        return Read([found.frame, found.centre_m, found.size_m, found.score, found.track])

    return read


def read_boxes_of_detector(name: str) -> Callable[[Path], Read]:
    """Detections in a detector's export."""

    def read(root: Path) -> Read:
        found = read_export(root / "tables" / name)
        return Read([found.frames, found.frame, found.label, found.centre_m, found.yaw_rad])

    return read


def read_submission(root: Path) -> Read:
    data = root / "nuscenes"
    request = command.Request(data, "v1.0-trainval", str(root / "s.txt"), root / "submission.json")
    evaluation = command.run(request)
    summary = evaluation.metrics.as_dict() if hasattr(evaluation.metrics, "as_dict") else {}
    tracks = evaluation.prepared.tracks
    return Read([tracks.centre_m, tracks.score, str(summary)], list(evaluation.problems))


def read_result(root: Path) -> Read:
    result = SceneResult.load(root / "result.npz")
    return Read([result.tracks.centre_m, result.frames.stamp_ns])


def read_objects(root: Path) -> Read:
    found = load_objects(root / "scene.objects.npz")
    return Read([found.centre_m, found.score])


def read_flow_sums(root: Path) -> Read:
    found = load_sums(root / "scene.sceneflow.npz")
    return Read([found.official, *found.rows.values()])


# --- small files ---------------------------------------------------------------------------------


def write_all(root: Path) -> None:
    """Write one small data set of each kind, and what evaluations read."""
    from mottrack.datasets.synthetic import SyntheticConfig
    from mottrack.datasets.writers import write_synthetic

    for kind, duration_s in KINDS:
        world = SyntheticConfig(scenes=1, seed=SEED, duration_s=duration_s)
        write_synthetic(root / kind, kind, world)
    _write_own_logs(root)
    _write_ground(root / "map")
    _write_mot(root / "mot")
    _write_tables(root / "tables")
    _write_eval_kitti(root)
    _write_submission(root)
    _write_result(root / "result.npz")
    _write_beside(root)


KINDS = (
    ("kitti", 0.3),
    ("nuscenes", 0.55),
    ("argoverse2", 0.3),
    ("t4", 0.3),
    ("truckscenes", 0.55),
)
"""Formats that are written, and the shortest scene of each that holds two key frames."""


def _write_own_logs(root: Path) -> None:
    from tests.datasets import ros_log
    from tests.datasets.makers import embedded_scenes
    from tests.datasets.ros import bags

    scene = embedded_scenes()[0]
    write_own_log(root / "folder/log", scene)
    first = sorted((root / "folder/log/sweeps").glob("*.bin"))[0]
    values = np.fromfile(first, "<f4").reshape(-1, 4)
    np.savez(first.with_suffix(".npz"), xyz_m=values[:200, :3], reflectance=values[:200, 3])
    first.unlink()
    (root / "ros").mkdir()
    frames, sweeps = ([read(i) for i in range(3)] for read in (scene.frame, scene.sweep))
    clouds = {s.stamp_ns: ros_log.structured(s.xyz_m, 255.0 * s.reflectance) for s in sweeps}
    poses = {frame.stamp_ns: frame.world_T_ego for frame in frames}
    ros_log.write_log(root / "ros/log.mcap", clouds, poses)
    bags.write_bag(root / "bags/drive", bags.drive(), "sqlite")
    bags.write_ros1(root / "ros1/drive.bag", bags.drive())
    shutil.rmtree(root / "ros1/drive")


def _write_ground(folder: Path) -> None:
    folder.mkdir()
    heights = np.linspace(0, 1, 60, dtype=np.float32).reshape(6, 10)
    np.save(folder / "x_ground_height_surface____Y.npy", heights)
    transform = {"R": [1.0, 0.0, 0.0, 1.0], "t": [1.0, 2.0], "s": 3.0}
    (folder / "x___img_Sim2_city.json").write_text(json.dumps(transform))


def _write_mot(folder: Path) -> None:
    folder.mkdir()
    rows = [(f, i, 10.0 * i + f, 20.0, 30.0, 60.0) for f in range(1, 6) for i in (1, 2, 3)]
    truth = [",".join(map(str, (*row, 1, 1, 0.9))) for row in rows]
    tracks = [",".join(map(str, (*row, 0.5, -1, -1, -1))) for row in rows]
    (folder / "gt.txt").write_text("\n".join(truth) + "\n")
    (folder / "tracks.txt").write_text("\n".join(tracks) + "\n")


def _write_tables(folder: Path) -> None:
    folder.mkdir()
    numbers = ("x", "y", "z", "length", "width", "height", "yaw")
    place = np.repeat(np.arange(5), 3)
    columns: dict[str, Any] = {"stamp_ns": place * SECOND_NS, "score": np.full(15, 0.5)}
    rng = np.random.default_rng(SEED)
    columns |= {name: rng.uniform(1.0, 2.0, 15) for name in numbers}
    columns |= {"id": np.tile(["1", "2", "3"], 5), "label": np.full(15, "car")}
    for name in ("tracks.csv", "tracks.parquet"):
        write_box_rows(folder / name, columns)
    boxes = np.column_stack([columns[name] for name in numbers])
    frames = [
        {
            "frame_id": str(k),
            "name": ["car"] * 3,
            "score": [0.5] * 3,
            "boxes_lidar": boxes[3 * k : 3 * k + 3].tolist(),
        }
        for k in range(5)
    ]
    (folder / "export.json").write_text(json.dumps(frames))
    arrays = {"frames": np.arange(5).astype(np.str_), "frame": place, "boxes": boxes}
    np.savez(folder / "export.npz", **arrays, label=columns["label"], score=columns["score"])


def _write_eval_kitti(root: Path) -> None:
    labels = (root / "kitti/training/label_02/0000.txt").read_text()
    for name, score in (("labels", ""), ("tracks", " 0.7")):
        (root / "eval_kitti" / name).mkdir(parents=True)
        text = "".join(f"{line}{score}\n" for line in labels.splitlines())
        (root / "eval_kitti" / name / "0000.txt").write_text(text)


def _write_submission(root: Path) -> None:
    tables = root / "nuscenes/v1.0-trainval"
    names = [row["name"] for row in json.loads((tables / "scene.json").read_text())]
    (root / "s.txt").write_text("\n".join(names))
    content = json.loads((root / "nuscenes/detections/synthetic.json").read_text())
    keep = ("sample_token", "translation", "size", "rotation", "velocity")
    results = {
        token: [
            {name: box[name] for name in keep}
            | {"tracking_id": str(i), "tracking_name": "car", "tracking_score": 0.5}
            for i, box in enumerate(boxes)
        ]
        for token, boxes in content["results"].items()
    }
    meta = content["meta"]
    (root / "submission.json").write_text(json.dumps({"meta": meta, "results": results}))


def _write_beside(root: Path) -> None:
    dataset = open_dataset("synthetic", Path())
    boxes = dataset.scene(dataset.scene_names[0]).frame(0).detections
    assert boxes is not None
    save_objects(root / "scene.objects.npz", [SceneObjects.at(0, boxes)])
    save_sums(root / "scene.sceneflow.npz", empty_sums())


def _write_result(path: Path) -> None:
    dataset = open_dataset("synthetic", Path())
    scene = dataset.scene(dataset.scene_names[0])
    frames = [scene.frame(i) for i in range(2)]
    tables = FrameTable.of(frames), TruthTable.of(frames), TrackTable.of([])
    SceneResult("scene", *tables).save(path)


# --- the table -----------------------------------------------------------------------------------

TABLES = "nuscenes/v1.0-trainval"
QUATERNION, PLACE = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
SIZE = ("length_m", "width_m", "height_m")
BOX = (*QUATERNION, *PLACE, *SIZE)
LINKED = {"token": "token", "prev": "token", "next": "token"}
PLACED = {"translation": "place", "size": "size", "rotation": "rotation"}


def table(name: str, /, *, lost: bool = True, **fields: str) -> Target:
    damages = common(never) | Records(fields, lost).damages()
    return Target(f"{TABLES}/{name}.json", read_scene("nuscenes"), damages)


def text(
    path: str, read: Callable[[Path], Read], rows: TextRows, columns: int, fewest: int = 0
) -> Target:
    may_be_empty = not rows.header and path != "kitti/training/poses/0000.txt"
    whole_at = in_last_value(columns, rows.separator, fewest)
    return Target(path, read, common(whole_at, may_be_empty=may_be_empty) | rows.damages())


def arrow(path: str, damage: Arrow, read: Callable[[Path], Read]) -> Target:
    return Target(path, read, common(never) | damage.damages())


def span(first: int, end: int) -> tuple[int, ...]:
    return tuple(range(first, end))


TARGETS: dict[str, Target] = {
    "kitti labels": text(
        "kitti/training/label_02/0000.txt",
        read_scene("kitti"),
        TextRows((0, 1, *span(3, 17)), bounded=span(10, 17)),
        17,
    ),
    "kitti poses": text(
        "kitti/training/poses/0000.txt",
        read_scene("kitti"),
        TextRows(span(0, 12), bounded=span(0, 12)),
        12,
    ),
    "kitti calibration": text(
        "kitti/training/calib/0000.txt", read_scene("kitti"), TextRows(span(1, 10)), 13
    ),
    "kitti detections": text(
        "kitti/detections/pointrcnn/Car/0000.txt",
        read_scene("kitti"),
        TextRows(span(0, 14), ",", bounded=span(7, 14)),
        14,
    ),
    "kitti sweep": Target(
        "kitti/training/velodyne/0000/000001.bin",
        read_scene("kitti", sweeps=True),
        common(after_points(16)) | Floats(4).damages(),
    ),
    "own poses": text(
        "folder/log/poses.csv",
        read_scene("folder"),
        TextRows(span(0, 8), ",", bounded=span(1, 8), header=True),
        8,
    ),
    "own boxes": text(
        "folder/log/boxes.csv",
        read_scene("folder"),
        TextRows((0, 1, *span(3, 10)), ",", bounded=span(3, 10), header=True),
        10,
    ),
    "own detections": text(
        "folder/log/detections.csv",
        read_scene("folder"),
        TextRows((0, *span(2, 10)), ",", bounded=span(3, 10), header=True),
        10,
    ),
    "own sweep": Target(
        "folder/log/sweeps/*.npz",
        read_scene("folder", sweeps=True),
        common(never) | npz_damages(),
    ),
    "ros log": Target("ros/log.mcap", bag_reader("ros", None), common(never)),
    "ros 1 bag": Target("ros1/drive.bag", bag_reader("ros1"), common(never)),
    "ros sqlite bag": Target("bags/drive/drive.db3", bag_reader("bags"), common(never)),
    "ros metadata": Target("bags/drive/metadata.yaml", bag_reader("bags"), common(always)),
    "t4 sweep": Target(
        "t4/*/data/LIDAR_CONCAT/*.pcd.bin",
        read_scene("t4", sweeps=True),
        common(after_points(20)) | Floats(5).damages(),
    ),
    "t4 sample_data": Target(
        "t4/*/annotation/sample_data.json",
        read_scene("t4"),
        common(never)
        | Records(
            {**LINKED, "timestamp": "time", "is_key_frame": "flag", "filename": "file"}, True
        ).damages(),
    ),
    "truckscenes sweep": Target(
        "truckscenes/samples/LIDAR_TOP_LEFT/*.pcd",
        read_scene("truckscenes", sweeps=True),
        common(never),
    ),
    "nuscenes scene": table("scene", token="token", name="reference", nbr_samples="count"),
    "nuscenes sample": table("sample", **LINKED, timestamp="time", scene_token="token"),
    "nuscenes sample_data": table(
        "sample_data",
        **LINKED,
        sample_token="token",
        ego_pose_token="token",
        calibrated_sensor_token="token",
        timestamp="time",
        is_key_frame="flag",
        filename="file",
    ),
    "nuscenes ego_pose": table("ego_pose", token="token", translation="place", rotation="rotation"),
    "nuscenes annotations": table(
        "sample_annotation",
        **LINKED,
        **PLACED,
        sample_token="token",
        instance_token="token",
        num_lidar_pts="count",
        num_radar_pts="count",
    ),
    "nuscenes instance": table(
        "instance", token="token", category_token="token", nbr_annotations="count"
    ),
    "nuscenes category": table("category", token="reference", name="reference"),
    "nuscenes sensor": table("sensor", token="token", channel="reference"),
    "nuscenes mounting": table(
        "calibrated_sensor", token="token", sensor_token="token", translation="place"
    ),
    "nuscenes sweep": Target(
        "nuscenes/samples/LIDAR_TOP/*.pcd.bin",
        read_scene("nuscenes", sweeps=True),
        common(after_points(20)) | Floats(5).damages(),
    ),
    "nuscenes detections": Target(
        "nuscenes/detections/synthetic.json",
        read_scene("nuscenes"),
        common(never)
        | Results(
            PLACED
            | {"sample_token": "token", "detection_name": "class", "detection_score": "score"}
        ).damages()
        | {"bad velocity": Results({"velocity": "speed"}).bad_value},
    ),
    "nuscenes submission": Target(
        "submission.json",
        read_submission,
        common(never)
        | Results(
            PLACED | {"sample_token": "token", "tracking_name": "class", "tracking_score": "score"}
        ).damages()
        | {"bad velocity": Results({"velocity": "speed"}).bad_value}
        | {"bad identity": Results({"tracking_id": "identity"}).bad_value},
    ),
    "argoverse2 poses": arrow(
        "argoverse2/val/*/city_SE3_egovehicle.feather",
        Arrow((*QUATERNION, *PLACE), (*QUATERNION, *PLACE), ("timestamp_ns",)),
        read_scene("argoverse2"),
    ),
    "argoverse2 annotations": arrow(
        "argoverse2/val/*/annotations.feather",
        Arrow(BOX, BOX, ("timestamp_ns", "num_interior_pts"), ("track_uuid", "category")),
        read_scene("argoverse2"),
    ),
    "argoverse2 detections": arrow(
        "argoverse2/detections.feather",
        Arrow((*BOX, "score"), BOX, ("timestamp_ns",), ("log_id", "category")),
        read_scene("argoverse2"),
    ),
    "argoverse2 sweep": arrow(
        "argoverse2/val/*/sensors/lidar/*.feather",
        Arrow(("x", "y", "z"), ("x", "y", "z"), ("laser_number", "offset_ns"), unique=False),
        read_scene("argoverse2", sweeps=True),
    ),
    "argoverse2 heights": Target("map/*.npy", read_ground, common(never) | npy_damages()),
    "argoverse2 transform": Target("map/*.json", read_ground, common(never)),
    "mot truth": text("mot/gt.txt", read_mot, TextRows(span(0, 8), ",", bounded=span(2, 6)), 9, 6),
    "mot tracks": text(
        "mot/tracks.txt", read_mot, TextRows(span(0, 8), ",", bounded=span(2, 6)), 10, 6
    ),
    "kitti eval labels": text(
        "eval_kitti/labels/0000.txt",
        read_kitti,
        TextRows((0, 1, *span(3, 17)), bounded=span(6, 17)),
        17,
    ),
    "kitti eval tracks": text(
        "eval_kitti/tracks/0000.txt",
        read_kitti,
        TextRows((0, 1, *span(3, 18)), bounded=span(6, 17)),
        18,
    ),
    "tracks csv": text(
        "tables/tracks.csv",
        read_table("tracks.csv"),
        TextRows(span(0, 9), ",", bounded=span(2, 9), header=True),
        11,
    ),
    "tracks Parquet": Target("tables/tracks.parquet", read_table("tracks.parquet"), common(never)),
    "detector json": Target(
        "tables/export.json", read_boxes_of_detector("export.json"), common(never)
    ),
    "detector npz": Target(
        "tables/export.npz", read_boxes_of_detector("export.npz"), common(never)
    ),
    "stored result": Target(
        "result.npz",
        read_result,
        {"cut": cut(never), "garbage": garbage, "empty": empty, "flip": flip},
    ),
    "stored objects": Target(
        "scene.objects.npz",
        read_objects,
        {"cut": cut(never), "garbage": garbage, "empty": empty, "flip": flip},
    ),
    "stored scene flow": Target(
        "scene.sceneflow.npz",
        read_flow_sums,
        {"cut": cut(never), "garbage": garbage, "empty": empty, "flip": flip},
    ),
}


def concerns_of(read: Read) -> list[Concern]:
    return [warning for warning in read.warnings if isinstance(warning, Concern)]

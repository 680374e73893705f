"""Print, for kinds of faults that once passed silently or ended in a traceback, what is said now.

    python -m tests.fuzz.faults_table > docs/faults.md

Every line is printed by the code itself, on small files that are written and damaged for it.
"""

# ruff: noqa: S106, E501 - tokens of records; texts of a table

from __future__ import annotations

import io
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather

from mottrack import MottrackError, Objects, Pipeline, Pose
from mottrack.core.memory import exhausted
from mottrack.experiment.experiment import load_to_stream
from mottrack.flow.pillarflow.weights_file import load_weights
from mottrack.trackers import KalmanTracker
from tests.fuzz.run import file_of
from tests.fuzz.targets import TARGETS, Read, write_all

Printed = Callable[[Path], str]
TABLES = "nuscenes/v1.0-trainval"


def said(root: Path, read: Callable[[], object]) -> str:
    """Return the error that reading ends with, or its warnings, as the command line prints them."""
    try:
        found = read()
    except MottrackError as error:
        return str(error).replace(f"{root}/", "")
    warnings = found.warnings if isinstance(found, Read) else []
    text = f"warning: {str(warnings[0]).removeprefix('warning: ')}" if warnings else "accepted"
    return text.replace(f"{root}/", "")


def changed(name: str, change: Callable[[bytes], bytes]) -> Printed:
    """Damage the file of a target, read it, and put it back."""

    def printed(root: Path) -> str:
        target = TARGETS[name]
        file = file_of(root, target)
        data = file.read_bytes()
        file.write_bytes(change(data))
        try:
            return said(root, lambda: target.read(root))
        finally:
            file.write_bytes(data)

    return printed


def replaced(name: str, old: str, new: str, count: int = 1) -> Printed:
    return changed(name, lambda data: data.replace(old.encode(), new.encode(), count))


def rows(name: str, change: Callable[[list[str]], list[str]]) -> Printed:
    def edit(data: bytes) -> bytes:
        return ("\n".join(change(data.decode().splitlines())) + "\n").encode()

    return changed(name, edit)


def record(name: str, **fields: Any) -> Printed:
    def edit(data: bytes) -> bytes:
        content = json.loads(data)
        first = content[0] if isinstance(content, list) else _first_box(content)
        first.update(fields)
        return json.dumps(content).encode()

    return changed(name, edit)


def _first_box(content: dict[str, Any]) -> dict[str, Any]:
    return next(boxes[0] for boxes in content["results"].values() if boxes)


def every_box(name: str, change: Callable[[dict[str, Any]], object]) -> Printed:
    def edit(data: bytes) -> bytes:
        content = json.loads(data)
        for boxes in content["results"].values():
            for box in boxes:
                change(box)
        return json.dumps(content).encode()

    return changed(name, edit)


def popped(name: str) -> Printed:
    return changed(name, lambda data: json.dumps(json.loads(data)[:-1]).encode())


def through_float(data: bytes) -> bytes:
    table = pa.feather.read_table(pa.BufferReader(data))
    at = table.column_names.index("timestamp_ns")
    values = pa.array([int(float(v + 37)) for v in table["timestamp_ns"].to_pylist()], pa.int64())
    out = io.BytesIO()
    pa.feather.write_feather(table.set_column(at, "timestamp_ns", values), out)
    return out.getvalue()


def microseconds(lines: list[str]) -> list[str]:
    shorter = [
        ",".join([str(int(line.split(",")[0]) // 1000), *line.split(",")[1:]]) for line in lines[1:]
    ]
    return [lines[0], *shorter]


def bomb(_data: bytes) -> bytes:
    table = pa.table({n: np.zeros(60_000_000, np.float32) for n in ("x", "y", "z", "intensity")})
    for name in ("laser_number", "offset_ns"):
        table = table.append_column(name, pa.array(np.zeros(60_000_000, np.int8)))
    out = io.BytesIO()
    pa.feather.write_feather(table, out, compression="zstd")
    return out.getvalue()


def experiment(text: str, *overrides: str) -> Printed:
    def printed(root: Path) -> str:
        path = root / "my.yaml"
        path.write_text(text)
        return said(root, lambda: load_to_stream(str(path), list(overrides)))

    return printed


def fed(pipeline: tuple[str, ...], *frames: dict[str, Any]) -> Printed:
    def printed(_root: Path) -> str:
        made = Pipeline.from_config("demo", *pipeline)

        def feed() -> str:
            return [made.feed(**frame) for frame in frames][-1]  # type: ignore[return-value]

        try:
            step: Any = feed()
        except MottrackError as error:
            return str(error)
        field = "no field" if step.field is None else f"{int(step.field.valid.sum())} cells"
        return f"accepted: {field}, {len(step.tracks)} tracks"

    return printed


def frame(k: int, **changes: Any) -> dict[str, Any]:
    points = np.random.default_rng(0).uniform(-30, 30, (3000, 3)) * [1, 1, 0.03] + [0, 0, 1]
    found = {
        "frame": "ego",
        "centre_m": [[9.0, 0.0, 0.8]],
        "size_m": [[4.5, 1.9, 1.6]],
        "yaw_rad": [0.0],
        "label": ["car"],
        "score": [0.9],
    }
    given = {"stamp_ns": k * 10**8, "points": points, "world_T_ego": Pose.identity()}
    return given | {"detections": found} | changes


def jumped(metres: float) -> dict[str, Any]:
    return frame(3, world_T_ego=Pose.from_yaw(0.0, (metres, 0.0, 0.0)))


def stepped(_root: Path) -> str:
    try:
        KalmanTracker().step(400_000_000, Objects.empty(700_000_000))
    except MottrackError as error:
        return str(error)
    return "accepted"


def weights(old: str, new: str) -> Printed:
    def printed(root: Path) -> str:
        from mottrack.flow.pillarflow.source import SHIPPED

        data = (SHIPPED / "small.safetensors").read_bytes()
        size = int.from_bytes(data[:8], "little")
        text = data[8 : 8 + size].decode()
        text = text.replace(old, new, 1)
        raw = text.encode()
        path = root / "weights.safetensors"
        path.write_bytes(len(raw).to_bytes(8, "little") + raw + data[8 + size :])
        return said(root, lambda: load_weights(path))

    return printed


ICP = ("flow=cluster_icp",)
DOGMA = ("flow=dogma", "flow.filter.particles=1000", "flow.filter.births=100")
GOOD = (frame(1), frame(2))
FAULTS: dict[str, dict[str, Printed]] = {
    "Once wrong and silent": {
        "Argoverse 2 detections whose stamps went through float64": changed(
            "argoverse2 detections", through_float
        ),
        "MOT text with an empty cell": rows(
            "mot tracks", lambda r: [",".join([*r[0].split(",")[:6], "", "-1,-1,-1"]), *r[1:]]
        ),
        "MOT tracks with one id twice in a frame": rows("mot tracks", lambda r: [*r, r[0]]),
        "KITTI results with one id twice in a frame": rows(
            "kitti eval tracks", lambda r: [*r, r[0]]
        ),
        "quaternions as x, y, z, w": every_box(
            "nuscenes detections",
            lambda b: b.update(rotation=[*b["rotation"][1:], b["rotation"][0]]),
        ),
        "stamps in microseconds": rows("own poses", microseconds),
        "a submission's sample_token is of no sample": record(
            "nuscenes submission", sample_token="x"
        ),
        "a translation of text": record("nuscenes annotations", translation=["1", "2", "3"]),
        "a translation of 1e300": record("nuscenes annotations", translation=[1e300, 0, 0]),
        "an annotation of no sample": record("nuscenes annotations", sample_token="x"),
        "an unknown category": record("nuscenes instance", category_token="x"),
        "a null time": record("nuscenes sample", timestamp=None),
        "a record removed": popped("nuscenes annotations"),
        "a token that points nowhere": record("nuscenes sample_data", ego_pose_token="x"),
        "an experiment of 0 bytes": experiment(""),
        "an experiment of null": experiment("null"),
        "labels in another spelling": replaced("own detections", ",car,", ",Car,", 999),
        "a detection twice": rows("own detections", lambda r: [*r, r[-1]]),
        "a decimal comma": rows(
            "own detections", lambda r: [r[0], r[1].replace(".", ",", 1), *r[2:]]
        ),
        "digits with underscores": rows("own poses", lambda r: [r[0], f"1_{r[1]}", *r[2:]]),
        "more poses than frames": rows("kitti poses", lambda r: [*r, *r]),
        "`tracker.step` with objects of another stamp": stepped,
        "masked entries, text for truth": fed(
            ICP, frame(1, points=np.ma.masked_equal([[1.0, 2.0, 3.0]], 2.0))
        ),
    },
    "Once a lost step or run": {
        "a pose jumps by 2 km, flow cluster_icp": fed(ICP, *GOOD, jumped(2000.0)),
        "a pose jumps by 100 m, flow dogma; the second step after it": fed(
            DOGMA, *GOOD, jumped(100.0), frame(4), frame(5)
        ),
        "a frame without detections, as empty lists": fed(
            ICP,
            frame(
                1,
                detections={k: [] for k in ("centre_m", "size_m", "yaw_rad", "label", "score")}
                | {"frame": "ego"},
            ),
        ),
        "an empty sweep of an own log": changed("own sweep", lambda _: b""),
        "memory is nearly exhausted": lambda _: exhausted(120 << 20),
    },
    "Once a traceback": {
        "`name: 2024-99-99`, a text": experiment("name: 2024-99-99\n", "flow=zero"),
        "`!!bool maybe`": experiment("name: !!bool maybe\n"),
        "a number of 5,000 digits": experiment(f"pair_s: {'9' * 5000}\n"),
        "`flow=.x:Y`": experiment("name: a\n", "flow=.x:Y"),
        "100,000 brackets of JSON": changed("nuscenes sample", lambda _: b"[" * 100_000),
        "`num_lidar_pts` of 2^64 - 1": record("nuscenes annotations", num_lidar_pts=2**64 - 1),
        "half a surrogate pair": record("nuscenes sample_data", filename="\ud800"),
        "a file name of 5,000 characters": record("nuscenes sample_data", filename="a" * 5000),
        "an npz that is none": changed("own sweep", lambda _: b"PK\x03\x04 and no more"),
        "points as text": fed(ICP, frame(1, points="points")),
        "points of ragged rows": fed(ICP, frame(1, points=[[1.0, 2.0, 3.0], [1.0]])),
    },
    "Hostile input": {
        "YAML whose aliases expand to gigabytes": experiment(
            "a0: &a0 [x, x]\n"
            + "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 30))
        ),
        "a feather of 60 million points": changed("argoverse2 sweep", bomb),
        "weights of another type": weights('"F32"', '"I32"'),
        "control characters in a label": replaced("own detections", ",car,", ",\x1b[2J,", 1),
    },
}


def table(root: Path) -> Iterator[str]:
    yield "# What is printed for faults"
    yield ""
    yield "Kinds of damage that once passed silently, ended in a traceback or filled the memory, and what is printed for each"
    yield "now. Made by `python -m tests.fuzz.faults_table`; paths are cut. The usual ones are explained under"
    yield "[usual mistakes](mistakes.md)."
    for title, faults in FAULTS.items():
        yield f"\n## {title}\n| input | what is printed |\n|---|---|"
        for name, printed in faults.items():
            text = printed(root).replace("|", "\\|").replace("\n", "; ").replace("`", "'")
            yield f"| {name} | `{text[:420]}` |"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MOTTRACK_CACHE"] = f"{folder}/cache"
        write_all(Path(folder))
        sys.stdout.write("\n".join(table(Path(folder))) + "\n")


if __name__ == "__main__":
    main()

"""E: messages that once named too little."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any
from unittest import mock

from mottrack.core import FrameTable, SceneResult, TrackTable, TruthTable
from mottrack.core.memory import SCARCE_BYTES
from mottrack.datasets.nuscenes.submission import Samples, write_submission
from tests.datasets.makers import open_dataset
from tests.fuzz.faults.printed import (
    Faults,
    Printed,
    called,
    changed,
    checked,
    command,
    in_process,
    raised,
    replaced,
)
from tests.fuzz.faults.section_a import EVALUATION

SCARCE = f"""
import resource, time
from pathlib import Path
from mottrack.core.memory import warn_when_scarce
pages = int(Path("/proc/self/statm").read_text().split()[0])
most = pages * resource.getpagesize() + {SCARCE_BYTES // 2}
resource.setrlimit(resource.RLIMIT_AS, (most, most))
warn_when_scarce()
time.sleep(0.3)
"""


def full_disk(root: Path) -> str:
    """Every write is refused, as the system does it: by a number, without the file."""
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with mock.patch("os.fsync", side_effect=full):
        done = called("synth", str(root / "full"), "--format", "kitti", "--duration", "0.2")
    return done.text.strip().replace(f"{root}/", "")


def scarce(_root: Path) -> str:
    return re.sub(r"\d+ MiB left", "74 MiB left", in_process(SCARCE))


def mini_split(root: Path) -> object:
    """The tracks of other scenes than those of the split."""
    dataset = open_dataset("nuscenes", root / "nuscenes", rate_hz=2)
    scene = dataset.scene(dataset.scene_names[0])
    frames = [scene.frame(index) for index in range(len(scene))]
    tables = FrameTable.of(frames), TruthTable.of(frames), TrackTable.of([])
    result = SceneResult(scene.name, *tables)
    expected = Samples([*result.frames.token.tolist(), "a" * 32, "b" * 32], "val")
    write_submission(root / "mini.json", [result], expected=expected)
    return None


def submission(change: Any) -> Printed:
    """What `eval nuscenes` says of a submission whose boxes were changed."""

    def printed(root: Path) -> str:
        file = root / "submission.json"
        data = file.read_bytes()
        content = json.loads(data)
        change(list(content["results"].values()))
        file.write_text(json.dumps(content))
        try:
            return command(*EVALUATION, word="submission.json", with_code=True)(root)
        finally:
            file.write_bytes(data)

    return printed


def warnings(samples: list[list[dict[str, Any]]]) -> None:
    samples[0][0]["rotation"] = [0.0, 0.0, 0.0, 0.0]
    samples[0][1]["tracking_score"] = 7.0


def warnings_and_error(samples: list[list[dict[str, Any]]]) -> None:
    warnings(samples)
    samples[0][2]["translation"] = ["x", 0.0, 0.0]


def other_name(folder: Path) -> None:
    for path in folder.glob("val/*/annotations.feather"):
        path.rename(path.with_name("annotations_with_ego.feather"))
        shutil.rmtree(path.parent / "sensors/lidar")


def few_sweeps(folder: Path) -> None:
    for path in sorted(folder.glob("val/*/sensors/lidar/*.feather"))[1:]:
        path.unlink()


def no_sweeps(folder: Path) -> None:
    for path in folder.glob("training/velodyne/*/*.bin"):
        path.unlink()


FAULTS: Faults = {
    "E1 no space left on the device": full_disk,
    "E1 little memory is left by `ulimit -v`": scarce,
    "E2 `check /nope`": command("check", "/nope"),
    "E3 an mcap cut by a killed recorder": changed("ros log", lambda data: data[:-20]),
    "E4 a ROS 1 bag that is cut": changed("ros 1 bag", lambda data: data[: len(data) // 2]),
    "E5 `submit` of a mini split": raised(mini_split),
    "E6 KITTI `check` without any sweep": checked("kitti", no_sweeps),
    "E7 annotations at every frame and few sweeps": checked(
        "argoverse2", few_sweeps, "require_sweeps"
    ),
    "E8 labels without a car that counts": replaced("kitti eval labels", "Car", "Van", 999),
    "E9 `eval nuscenes`: a zero quaternion and a score of 7": submission(warnings),
    "E9 the same beside an error": submission(warnings_and_error),
    "E10 an Argoverse 2 folder of `annotations_with_ego.feather`": checked(
        "argoverse2", other_name
    ),
    "E11 the head line of `check`": checked("kitti", lambda _: None),
}

"""B: faults that once lost a step or a run."""

from __future__ import annotations

import multiprocessing
import os
import re
import shutil
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from mottrack import MottrackError, Objects, Pose
from mottrack.datasets.ros import new_messages as ros
from mottrack.runs.local_pool import _Pool, _Worker
from mottrack.runs.lock import only_driver
from mottrack.runs.runner import SceneTask
from mottrack.trackers import FixedLagTracker
from tests.datasets import ros_log
from tests.datasets.ros import bags
from tests.fuzz.faults.finished import Silent
from tests.fuzz.faults.printed import (
    Faults,
    Printed,
    changed,
    command,
    fed,
    frame,
    in_process,
    jumped,
    raised,
    said,
)
from tests.fuzz.targets import bag_reader, read_scene

RUN = (
    "import sys; from pathlib import Path; from mottrack.cli import main;"
    "sys.argv[0] = 'mottrack'; main()"
)
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
GOOD = (frame(1), frame(2))
GRID = ("grid.x_min_m=-16", "grid.x_max_m=16", "grid.y_min_m=-16", "grid.y_max_m=16")
DOGMA = ("flow=dogma", "flow.filter.particles=1000", "flow.filter.births=100", *GRID)
NO_BOXES: dict[str, Any] = {
    name: [] for name in ("centre_m", "size_m", "yaw_rad", "label", "score")
} | {"frame": "ego"}


def refused_then_good(_root: Path) -> str:
    """A step at a wrong stamp changes nothing: the next good one is taken."""
    tracker = FixedLagTracker()
    tracker.step(100_000_000, Objects.empty(100_000_000))
    try:
        tracker.step(900_000_000, Objects.empty(300_000_000))
    except MottrackError as error:
        refused = str(error)
    tracker.step(200_000_000, Objects.empty(200_000_000))
    return f"{refused}; the step at 200000000 after it is accepted"


class _Dead:
    """A process that has ended."""

    def join(self) -> None: ...


def dead_between(_root: Path) -> str:
    """A worker whose connection is closed when it is given its next scene."""
    hired = []

    class Pool(_Pool):
        def start_worker(self) -> None:
            hired.append(True)

    pool = Pool(Silent(), deque([SceneTask("a", ())]))  # type: ignore[arg-type]
    ours, theirs = multiprocessing.Pipe()
    theirs.close()
    pool._give_task(_Worker(_Dead(), ours, served=True))  # type: ignore[arg-type]
    return f"{len(hired)} other worker is hired, {len(pool.queue)} scene waits for it"


def dead_within(root: Path) -> str:
    """Each worker that is given the scene is killed."""
    (root / "toy.yaml").write_text(
        "dataset: {kind: 'toy_plugins:ToyDataset', scenes: [killed]}\n"
        "flow: zero\ntracker: {kind: 'toy_plugins:EchoTracker'}\nscore_flow: false\n"
    )
    out = str(root / "killed")
    text = in_process(RUN, "run", str(root / "toy.yaml"), "--out", out, "--workers", "1")
    return next((line for line in text.splitlines() if "killed:" in line), text)


def empty_cloud(root: Path) -> str:
    folder = root / "empty_cloud"
    folder.mkdir()
    stamps = [k * 10**8 for k in range(1, 4)]
    points = {stamp: ros_log.structured(np.ones((200, 3)), np.ones(200)) for stamp in stamps}
    points[stamps[1]] = points[stamps[1]][:0]
    ros_log.write_log(folder / "log.mcap", points, {s: Pose.identity() for s in stamps})
    return said(root, lambda: bag_reader("empty_cloud", None)(root))


def pose_stamped(root: Path) -> str:
    """PoseStamped in the place of odometry is read."""
    times = bags.stamps(0.0, 0.4, 10)
    messages = [*bags.clouds(times, frame="base_link")]
    for stamp in times:
        stamped = ros.header(stamp, "map")
        pose = ros.pose_of(bags.world_T_ego(stamp))
        messages.append(
            bags.Message("/pose", stamp, ros.new("geometry_msgs/PoseStamped", stamped, pose))
        )
    (root / "posed").mkdir()
    bags.write_bag(root / "posed/drive", messages)
    return said(root, lambda: bag_reader("posed", None)(root))


def swapped(root: Path) -> str:
    topics = {"points_topic": "/odometry", "odometry_topic": "/points", "detections_topic": None}
    return said(root, lambda: read_scene("ros", sweeps=True, truth_topic=None, **topics)(root))


def read_only(root: Path) -> str:
    """No folder can be made beside the program nor in a home: numba would end with a traceback."""
    program = root / "package/program.py"
    program.parent.mkdir()
    (program.parent / "__pycache__").write_text("a file where numba would make a folder")
    program.write_text(
        "from mottrack.compiled import compiled\n@compiled\ndef twice(x):\n    return 2.0 * x\n"
        "print('accepted: a compiled function returns', twice(1.5))\n"
    )
    code = f"import runpy; runpy.run_path({str(program)!r})"
    return in_process(code, HOME=str(program), TMPDIR=str(program))


def other_bytes(root: Path) -> str:
    text = in_process(RUN, "check", os.fsencode(root / "ü ☃ \udcff"), **C_LOCALE)
    return text.replace(f"{root}/", "")


def other_folder(root: Path) -> str:
    """A run in a folder with a name of other bytes, on a terminal of ASCII."""
    out = root / "out ü ☃ \udcff"
    settings = ("flow=zero", "score_flow=false", "dataset.scenes=1", "dataset.duration_s=0.4")
    arguments = ("run", "demo", *settings, "--workers", "1", "--out", os.fsencode(out))
    text = in_process(RUN, *arguments, **C_LOCALE)
    made = all((out / name).is_file() for name in ("report.html", "scores.json"))
    shutil.rmtree(out)
    return "accepted: report.html and scores.json are written" if made else text


def two_runs(root: Path) -> str:
    with only_driver(root / "shared"):
        text = command("run", "demo", "flow=zero", "--out", "{root}/shared")(root)
    return re.sub(r"process \d+ on \S+;", "process 1234 on HOST;", text)


FORKED = """
import multiprocessing, numpy as np
from mottrack import MottrackError, Pipeline
points = np.random.default_rng(0).uniform(-15, 15, (500, 3))
def steps(first):
    for k in (first, first + 1):
        step = pipeline.feed(k * 10**8, points, np.eye(4))
    return step.field is not None
def child(answer):
    try:
        answer.put(f"accepted: the child measures {steps(2)}")
    except MottrackError as error:
        answer.put(str(error))
import sys
pipeline = Pipeline.from_config("demo", "objects=clusters", *sys.argv[1:])
steps(0)
context = multiprocessing.get_context("fork")
answer = context.SimpleQueue()
process = context.Process(target=child, args=(answer,))
process.start()
process.join(60)
print("the child hangs" if process.is_alive() else answer.get())
process.kill()
"""


def forked(*flow: str) -> Printed:
    """What a child says that was forked from a process that has used a flow source."""
    return lambda _root: in_process(FORKED, *flow, *GRID, PYTHONWARNINGS="ignore").splitlines()[-1]


def clouds_outside(root: Path) -> str:
    return said(root, lambda: bag_reader("bags")(root))


def no_boxes(_root: Path) -> str:
    none = Objects(stamp_ns=0, centre_m=[], size_m=[], yaw_rad=[], label=[], score=[])
    return f"{len(none)} objects"


FAULTS: Faults = {
    f"B1 a pose jumps by {far} km, flow {flow}": fed((f"flow={flow}",), *GOOD, jumped(1000.0 * far))
    for flow, far in (("icp", 2), ("icp_one_start", 2), ("cluster_icp", 2), ("cluster_icp", 10))
} | {
    "B2 a pose jumps by 100 m, flow dogma; the second step after it": fed(
        DOGMA, *GOOD, jumped(100.0), frame(4), frame(5)
    ),
    "B3 `FixedLagTracker.step` refused at a wrong stamp": refused_then_good,
    "B4 a worker that dies between its result and its next scene": raised(dead_between),
    "B4 a scene that kills its worker every time": dead_within,
    "B5 `Objects(..., centre_m=[], ...)`": raised(no_boxes),
    "B5 the same through `Pipeline.feed`": fed(
        ("flow=cluster_icp",), frame(1, detections=NO_BOXES)
    ),
    "B6 an empty sweep of a `folder` log": changed("own sweep", lambda _: b""),
    "B6 an empty cloud of a `ros` log": empty_cloud,
    "B6 clouds before the first and after the last odometry": clouds_outside,
    "B7 PoseStamped as odometry": pose_stamped,
    "B7 topics swapped": swapped,
    "B8 read-only installation and no writable HOME": read_only,
    "B9 a path that is not UTF-8 and a terminal of ASCII: `check` of nothing": other_bytes,
    "B9 the same: `run`": other_folder,
    "B10 two runs in one folder at once": two_runs,
    "B11 fork of a process that has used `dogma`": forked(
        "flow=dogma", "flow.filter.particles=500", "flow.filter.births=50"
    ),
    "B11 fork of a process that has used `pillarflow`": forked(
        "flow=pillarflow", "flow.weights=small"
    ),
}

"""`mottrack eval mot` beside motrics, TrackEval and py-motmetrics, each in a fresh process.

Every process reads the same text files and computes CLEAR, IDF1 and HOTA (py-motmetrics has no
HOTA). Figures are compared before times are printed: HOTA and IDF1 with TrackEval and motrics,
MOTA with py-motmetrics, whose rule of carrying a match over a gap is ours. The peers live in the
environment of `make oracle`. The best of several runs counts: a machine is never faster than it is.
On a shared machine read the CPU seconds: wall time is that of everybody.

    python benchmarks/eval_mot.py --quick     a sequence of TUD-Campus' size, and a crowd
    python benchmarks/eval_mot.py             and seven sequences as large as MOT17's
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _common import arguments, report

ROOT = Path(__file__).resolve().parents[1]
PEER_PYTHON = ROOT / ".venv-oracle/bin/python"
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
REPEATS = 5
TOLERANCE = 1e-9


class Size(NamedTuple):
    """Of a set of sequences."""

    sequences: int
    frames: int
    boxes: int
    """In a frame."""


CAMPUS = Size(1, 71, 5)
MOT17 = Size(7, 759, 21)
CROWD = Size(1, 2, 10_000)

LOAD = """
import json, sys
import numpy as np
def load(path):
    rows = np.loadtxt(path, delimiter=",", usecols=range(6))
    box = np.column_stack([rows[:, 2:4], rows[:, 2:4] + rows[:, 4:6]])
    return rows[:, 0].astype(int), rows[:, 1].astype(int), box
def by_frame(side, frames):
    edges = np.searchsorted(side[0], np.arange(1, frames + 2))
    return [(side[1][a:b], side[2][a:b]) for a, b in zip(edges, edges[1:])]
def sequences():
    for folder in sys.argv[1:]:
        truth, tracks = load(folder + "/gt.txt"), load(folder + "/test.txt")
        frames = max(truth[0].max(), tracks[0].max())
        yield by_frame(truth, frames), by_frame(tracks, frames)
def iou(a, b):
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=2)
    area = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b)]
    return shared / (area[0][:, None] + area[1][None] - shared)
"""
PEERS = {
    "motrics": """
import json, sys, motrics
out = []
for folder in sys.argv[1:]:
    truth = motrics.load_motchallenge(folder + "/gt.txt")
    tracks = motrics.load_motchallenge(folder + "/test.txt")
    a, b, c, d = motrics.align_frames(truth, tracks)
    r = motrics.evaluate(motrics.Frames(ids=a, boxes=b), motrics.Frames(ids=c, boxes=d))
    out.append({"hota": r.hota.hota, "idf1": r.identity.idf1})
print(json.dumps(out))
""",
    "TrackEval": LOAD
    + """
from trackeval.metrics import CLEAR, HOTA, Identity
out, quiet = [], {"THRESHOLD": 0.5, "PRINT_CONFIG": False}
for truth, tracks in sequences():
    ids = [np.unique(np.concatenate([i for i, _ in side])) for side in (truth, tracks)]
    data = {"gt_ids": [np.searchsorted(ids[0], i) for i, _ in truth],
            "tracker_ids": [np.searchsorted(ids[1], i) for i, _ in tracks],
            "similarity_scores": [iou(a, b) for (_, a), (_, b) in zip(truth, tracks)],
            "num_gt_ids": len(ids[0]), "num_tracker_ids": len(ids[1]),
            "num_gt_dets": sum(len(i) for i, _ in truth),
            "num_tracker_dets": sum(len(i) for i, _ in tracks), "num_timesteps": len(truth)}
    CLEAR(quiet).eval_sequence(data)
    out.append({"hota": float(HOTA().eval_sequence(data)["HOTA"].mean()),
                "idf1": float(Identity(quiet).eval_sequence(data)["IDF1"])})
print(json.dumps(out))
""",
    "py-motmetrics": LOAD
    + """
import motmetrics
out = []
for truth, tracks in sequences():
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for (i, a), (j, b) in zip(truth, tracks):
        distance = 1 - iou(a, b)
        accumulator.update(i, j, np.where(distance <= 0.5, distance, np.nan))
    found = motmetrics.metrics.create().compute(accumulator, metrics=["mota", "idf1"]).iloc[0]
    out.append({"mota": float(found["mota"]), "idf1": float(found["idf1"])})
print(json.dumps(out))
""",
}


def write_sequences(folder: Path, size: Size) -> list[Path]:
    """Boxes that walk, and tracks of them with noise, gaps, changes of identity and false ones."""
    made = []
    for number in range(size.sequences):
        rng = np.random.default_rng(number)
        place = folder / f"{number}"
        place.mkdir(parents=True)
        side = np.sqrt(size.boxes) * 60
        start, step = rng.uniform(0, side, (size.boxes, 2)), rng.normal(0, 1, (size.boxes, 2))
        lines: dict[str, list[str]] = {"gt": [], "test": []}
        for frame in range(1, size.frames + 1):
            xy = start + step * frame
            _add(lines["gt"], frame, np.arange(size.boxes), xy)
            seen = rng.random(size.boxes) < 0.9
            identity = np.arange(size.boxes) + size.boxes * (frame // 100 % 2)
            noisy = xy + rng.normal(0, 3, xy.shape)
            _add(lines["test"], frame, identity[seen], noisy[seen])
        for name, content in lines.items():
            (place / f"{name}.txt").write_text("\n".join(content) + "\n")
        made.append(place)
    return made


def _add(lines: list[str], frame: int, identity: np.ndarray, xy: np.ndarray) -> None:
    lines += [
        f"{frame},{i + 1},{x:.3f},{y:.3f},40,80,1,-1,-1,-1"
        for i, (x, y) in zip(identity.tolist(), xy.tolist(), strict=True)
    ]


class Timed(NamedTuple):
    """Of the best of several runs."""

    wall_s: float
    cpu_s: float
    output: str


def timed(command: list[str], repeats: int) -> Timed:
    runs = []
    for _ in range(repeats):
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            command, env=THREADS | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        runs.append(Timed(wall, cpu, done.stdout))
    return Timed(min(r.wall_s for r in runs), min(r.cpu_s for r in runs), runs[0].output)


def ours(folders: list[Path], out: Path, repeats: int) -> tuple[Timed, list[dict[str, float]]]:
    command = [sys.executable, "-m", "mottrack", "eval", "mot", "--out", str(out)]
    for folder in folders:
        command += ["--truth", str(folder / "gt.txt"), "--tracks", str(folder / "test.txt")]
    taken = timed(command, repeats)
    content = json.loads((out / "mot.json").read_text())
    return taken, [row for name, row in content.items() if name != "all"]


def measure(name: str, size: Size, scratch: Path, repeats: int) -> list[dict[str, Any]]:
    folders = write_sequences(scratch / name, size)
    taken, figures = ours(folders, scratch / f"{name}-out", repeats)
    rows: list[dict[str, Any]] = [row_of(name, "mottrack", taken, 0.0)]
    for peer, script in PEERS.items():
        # the peers' matrices of a crowd need minutes and gigabytes, motrics' a minute
        if not PEER_PYTHON.is_file() or size is CROWD:
            continue
        taken = timed([str(PEER_PYTHON), "-c", script, *map(str, folders)], repeats)
        pairs = zip(json.loads(taken.output.splitlines()[-1]), figures, strict=True)
        worst = max(abs(theirs[k] - mine[k]) for theirs, mine in pairs for k in theirs)
        if worst > TOLERANCE:
            raise SystemExit(f"{name}: {peer} differs by {worst}")
        rows.append(row_of(name, peer, taken, worst))
    return rows


def row_of(name: str, tool: str, taken: Timed, worst: float) -> dict[str, Any]:
    times = {"wall_s": taken.wall_s, "cpu_s": taken.cpu_s}
    return {"set": name, "tool": tool, **times, "differs": worst}


def main() -> None:
    options = arguments(__doc__)
    sizes = {"TUD-Campus' size": CAMPUS, "2 frames of 10,000": CROWD}
    if not options.quick:
        sizes["MOT17's size"] = MOT17
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            row
            for name, size in sizes.items()
            for row in measure(name, size, Path(folder), 2 if options.quick else REPEATS)
        ]
    report(rows, options.json)


if __name__ == "__main__":
    main()

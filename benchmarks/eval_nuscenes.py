"""The nuScenes tracking evaluation beside the official devkit, on data of validation density.

Both run as whole processes on the same folder, and the evaluation alone is timed inside each. The
devkit lives in an environment of its own (`make oracle`); without it only our side is measured.

    python benchmarks/eval_nuscenes.py --quick            5 scenes, about a minute
    nice python benchmarks/eval_nuscenes.py               50 scenes, the devkit takes 10 minutes
    python benchmarks/eval_nuscenes.py --scenes 150 --without-peer
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PEER_PYTHON = ROOT / ".venv-oracle/bin/python"
PEER_SCRIPT = ROOT / "tests/oracle/devkit_evaluation.py"
OURS = "import sys; from mottrack.cli import main; sys.exit(main())"
ALONE = """
import json, sys, time
from pathlib import Path
from mottrack.eval.nuscenes.groundtruth import cached_ground_truth
from mottrack.eval.nuscenes.submission import read_submission, to_boxes
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.metrics import evaluate
from mottrack.formats.nuscenes_splits import resolve_split
root, rules = Path(sys.argv[1]), Rules()
truth = cached_ground_truth(root, "v1.0-trainval", resolve_split(str(root / "scenes.txt")), rules)
boxes = to_boxes(read_submission(root / "submission.json"), truth.samples, rules)
times = []
for _ in range(4):
    began = time.process_time()
    metrics = evaluate(truth, boxes, rules)
    times.append(time.process_time() - began)
print(json.dumps({"first_cpu_s": times[0], "evaluate_cpu_s": min(times[1:]), **metrics.total}))
"""


def timed(command: list[str], cache: Path) -> dict[str, Any]:
    """Runs a process; wall and CPU seconds and peak memory of it alone."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    places = {"MOTTRACK_CACHE": str(cache), "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}
    began = time.perf_counter()
    child = subprocess.Popen(
        command, env=os.environ | threads | places, stdout=subprocess.PIPE, text=True
    )
    output = child.stdout.read()
    # of this child: what `getrusage` tells is the largest of all that there were
    _, status, used = os.wait4(child.pid, 0)
    wall = time.perf_counter() - began
    if status:
        raise SystemExit(f"{command[:3]} failed with {status}")
    cpu = used.ru_utime + used.ru_stime
    return {"wall_s": wall, "cpu_s": cpu, "peak_mb": used.ru_maxrss / 1024, "output": output}


def _written(data: Path, scenes: int) -> int:
    """Write the data in a process of its own: a child's peak memory begins with its parent's."""
    command = [sys.executable, str(Path(__file__).with_name("_nuscenes_like.py"))]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*command, str(data), str(scenes)],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return int(done.stdout)


def measure_ours(data: Path, scratch: Path) -> dict[str, Any]:
    """The command from nothing (no cache, nothing compiled), again, and again; then evaluate()."""
    cache = scratch / "cache"
    command = [sys.executable, "-c", OURS, "eval", "nuscenes", "--dataroot", str(data)]
    command += ["--submission", str(data / "submission.json"), "--split", str(data / "scenes.txt")]
    command += ["--out", str(scratch / "ours"), "--no-picture"]
    names = ("first run", "second run", "third run")
    runs = {name: timed(command, cache) for name in names}
    for run in runs.values():
        run.pop("output")
    alone = timed([sys.executable, "-c", ALONE, str(data)], cache)
    return {**runs, "alone": json.loads(alone["output"].splitlines()[-1])}


def measure_peer(data: Path, scratch: Path) -> dict[str, Any] | None:
    """The devkit as a whole process, with the time of its evaluate() alone."""
    if not PEER_PYTHON.is_file():
        return None
    command = [str(PEER_PYTHON), str(PEER_SCRIPT), str(data), str(scratch / "peer")]
    run = timed(command, scratch)
    return {**run, "alone": json.loads(run.pop("output").splitlines()[-1])}


def worst_difference(scratch: Path) -> float:
    """The largest difference of any figure of metrics_summary.json."""
    ours, peer = (
        json.loads((scratch / side / "metrics_summary.json").read_text())
        for side in ("ours", "peer")
    )
    pairs = [
        (ours["label_metrics"][m][c], peer["label_metrics"][m][c])
        for m in ours["label_metrics"]
        for c in ours["label_metrics"][m]
    ]
    return max(abs(a - b) for a, b in pairs if a == a or b == b)


def report(result: dict[str, Any]) -> None:
    """Prints the table."""
    print(f"{result['scenes']} scenes, {result['boxes']} true boxes, as many predictions")
    rows = [("ours, " + k, v) for k, v in result["ours"].items() if k != "alone"]
    if result["peer"]:
        rows.append(("nuscenes-devkit 1.2.0", result["peer"]))
    for name, run in rows:
        print(
            f"  {name:<24} wall {run['wall_s']:8.2f} s  CPU {run['cpu_s']:8.2f} s"
            f"  peak {run['peak_mb']:6.0f} MB"
        )
    print(f"  evaluate() alone, ours   CPU {result['ours']['alone']['evaluate_cpu_s']:.4f} s")
    if result["peer"]:
        print(f"  evaluate() alone, devkit CPU {result['peer']['alone']['evaluate_cpu_s']:.2f} s")
        for name, value in result["ratio"].items():
            print(f"  ratio, {name}: {value:.0f}")
        print(f"  largest difference of any summary figure: {result['difference']:.2e}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--quick", action="store_true", help="5 scenes")
    parser.add_argument("--without-peer", action="store_true")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    scenes = 5 if options.quick else options.scenes
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        boxes = _written(scratch / "data", scenes)
        ours = measure_ours(scratch / "data", scratch)
        peer = None if options.without_peer else measure_peer(scratch / "data", scratch)
        result: dict[str, Any] = {"scenes": scenes, "boxes": boxes, "ours": ours, "peer": peer}
        if peer:
            whole = peer["cpu_s"]
            result["ratio"] = {
                "whole process, first run after installation": whole / ours["first run"]["cpu_s"],
                "whole process": whole / ours["third run"]["cpu_s"],
                "evaluate() alone": peer["alone"]["evaluate_cpu_s"]
                / ours["alone"]["evaluate_cpu_s"],
            }
            result["difference"] = worst_difference(scratch)
    report(result)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()

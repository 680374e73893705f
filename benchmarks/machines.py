"""Runs over a Ray cluster of three nodes on this machine, beside the local pool.

    kills        40 scenes of the embedded world, of which one raises and one kills its worker;
                 meanwhile workers, nodes and the driver are killed. All other results must be
                 those of an undisturbed local run, to the byte
    examples     shards of training examples, with the same kills: the bytes of local processes
    efficiency   scenes that Ray ends in the time in which the local pool ends others, two workers
                 each, side by side, start-up apart
    kitti        the sequences of KITTI tracking, local and on the three nodes: the same bytes

python benchmarks/machines.py kills --quick
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _common import report

REPOSITORY = Path(__file__).resolve().parents[1]
NODES = 3
TASK = "ray::run_task"
STORE_BYTES = 100 * 2**20
POISON = ("synthetic-s1000-0001", "synthetic-s1000-0002")


def environment() -> dict[str, str]:
    plugins = REPOSITORY / "tests" / "plugins"
    return {
        **os.environ,
        "RAY_USAGE_STATS_ENABLED": "0",
        "PYTHONPATH": f"{REPOSITORY}{os.pathsep}{plugins}",
    }


def start(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "mottrack", *arguments]
    return subprocess.Popen(command, env=environment(), stdout=subprocess.DEVNULL)


def timed(*arguments: str) -> float:
    begun = time.perf_counter()
    process = start(*arguments)
    if process.wait() not in (0, 3):  # 3: scenes have failed, as they should
        raise SystemExit(f"mottrack {' '.join(arguments)} ended with {process.returncode}")
    return time.perf_counter() - begun


def results(out: Path) -> dict[str, bytes]:
    files = [*out.rglob("scenes/*.npz"), *out.rglob("*.safetensors")]
    return {str(f.relative_to(out)): f.read_bytes() for f in sorted(files)}


class ThreeNodes:
    """A head without CPUs, which can't be lost, and nodes of one CPU each."""

    def __init__(self, nodes: int) -> None:
        from ray.cluster_utils import Cluster

        os.environ |= environment()
        head = {"num_cpus": 0, "include_dashboard": False, "object_store_memory": STORE_BYTES}
        self.cluster = Cluster(initialize_head=True, head_node_args=head)
        self.nodes = [self._add() for _ in range(nodes)]
        self.address = self.cluster.address

    def _add(self) -> Any:
        return self.cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES)

    def kill_node(self) -> None:
        self.cluster.remove_node(self.nodes.pop(0), allow_graceful=False)
        self.nodes.append(self._add())

    def kill_worker(self) -> bool:
        """Kill a process that runs a task, if any does, and only one of this cluster."""
        listed = subprocess.check_output(["ps", "-eo", "pid=,ppid=,args="], text=True)
        rows = [line.split(None, 2) for line in listed.splitlines() if line.count(" ") > 1]
        raylets = {pid for pid, parent, _ in rows if int(parent) == os.getpid()}
        found = [pid for pid, up, text in rows if up in raylets and text.startswith(TASK)]
        if found:
            os.kill(int(random.choice(found)), signal.SIGKILL)
        return bool(found)

    def stop(self) -> None:
        self.cluster.shutdown()


def kills(options: argparse.Namespace, out: Path) -> list[dict[str, object]]:
    scenes, wanted = (6, 4) if options.quick else (40, 50)
    world = [f"dataset.scenes={scenes}", "dataset.duration_s=2", "flow=icp", "snapshots.scenes=0"]
    timed("run", "demo", *world, "--out", str(out / "local"), "--workers", "2")
    expected = {k: v for k, v in results(out / "local").items() if not any(p in k for p in POISON)}
    run = ("run", "demo", "dataset.kind=faulty_plugins:FaultyWorld", *world)
    return [{"scenes": scenes, **disturbed(run, expected, wanted, out)}]


def examples(options: argparse.Namespace, out: Path) -> list[dict[str, object]]:
    shards, wanted = (20, 4) if options.quick else (60, 30)
    made = ("examples", "train_small", f"examples.pairs={2 * shards}")
    made += ("examples.per_shard=2", "examples.validation_pairs=4")
    timed(*made, "--out", str(out / "local"), "--workers", "2")
    return [{"shards": shards + 2, **disturbed(made, results(out / "local"), wanted, out)}]


def disturbed(
    command: tuple[str, ...], expected: dict[str, bytes], wanted: int, out: Path
) -> dict[str, object]:
    """Run a command on three nodes, again and again, until so many processes were killed."""
    there, done, rounds, random_ = ThreeNodes(NODES), dict.fromkeys(KINDS, 0), 0, random.Random(1)
    try:
        while sum(done.values()) < wanted:
            rounds += 1
            folder = out / f"round{rounds}"
            whole = (*command, "--out", str(folder), "--cluster", there.address)
            driver = start(*whole)
            while not finished(driver, folder, expected):
                if driver.poll() is not None:
                    driver = start(*whole)  # resumes: the driver was killed, or luck ran out
                time.sleep(random_.uniform(1.0, 4.0))
                if sum(done.values()) < wanted and driver.poll() is None:
                    kind = random_.choices(KINDS, (6, 2, 2))[0]
                    done[kind] += kill(kind, there, driver)
            if results(folder) != expected:
                raise SystemExit(f"{folder} differs from the local run")
    finally:
        there.stop()
    return {"rounds": rounds, **done, "identical": len(expected)}


KINDS = ("workers", "nodes", "drivers")


def kill(kind: str, there: ThreeNodes, driver: subprocess.Popen[bytes]) -> int:
    if kind == "workers":
        return int(there.kill_worker())
    if kind == "nodes":
        there.kill_node()
    else:
        driver.send_signal(signal.SIGKILL)
        driver.wait()
    return 1


def finished(driver: subprocess.Popen[bytes], out: Path, expected: dict[str, bytes]) -> bool:
    """Whether the driver has ended by itself and every sound scene is there."""
    return driver.poll() in (0, 3) and results(out).keys() == expected.keys()


def efficiency(options: argparse.Namespace, out: Path) -> list[dict[str, object]]:
    """Scenes that Ray and the local pool end in the same time, two workers each, side by side.

    Both run at once, so that whatever else the machine does slows both alike; the time in which
    both are at work is compared, from the end of each one's first scenes, hence warm.
    """
    scenes = 6 if options.quick else options.scenes
    chosen = [f"dataset.scenes={scenes}", f"dataset.duration_s={options.seconds}"]
    chosen += ["flow=pillarflow", "tracker=kalman", "snapshots.scenes=0"]
    context = multiprocessing.get_context("spawn")
    names = ("local", "ray")
    both = [context.Process(target=run_one, args=(name, chosen, out / name)) for name in names]
    for process in both:
        process.start()
    for process in both:
        process.join()
    if len(results(out / "local")) != scenes or results(out / "local") != results(out / "ray"):
        raise SystemExit("the results differ")
    ends = {name: json.loads((out / name / ENDS).read_text()) for name in names}
    begin = max(times[WARM_UP - 1] for times in ends.values())
    last = min(times[-1] for times in ends.values())
    done = {name: sum(begin < t <= last for t in times) for name, times in ends.items()}
    if not all(done.values()):
        raise SystemExit("one has ended before the other was warm: choose more --scenes")
    row = {"scenes": scenes, "scene s": options.seconds, "compared s": last - begin}
    return [{**row, **done, "ratio": done["ray"] / done["local"]}]


WARM_UP = 2  # scenes, one for each worker: they compile and load
ENDS, WARM = "ends.json", "warm"
START_S = 300.0  # until Ray has started and is warm, on a busy machine too


def run_one(name: str, chosen: list[str], out: Path) -> None:
    from mottrack.experiment.experiment import load_experiments
    from mottrack.runs.local_pool import LocalPool
    from mottrack.runs.ray_cluster import RayCluster
    from mottrack.runs.run_folder import RunFolder
    from mottrack.runs.runner import Execution, run_experiment

    (experiment,) = load_experiments("demo", chosen)
    executor = LocalPool(2) if name == "local" else RayCluster("ray", 2)
    watch, other = Ends(out / WARM), out.parent / "ray" / WARM
    end = time.monotonic() + START_S
    while name == "local" and not other.exists() and time.monotonic() < end:
        time.sleep(0.1)  # Ray starts more slowly
    run_experiment(experiment, RunFolder(out), execution=Execution(executor), progress=watch)
    (out / ENDS).write_text(json.dumps(watch.times))


class Ends:
    """Progress that notes when scenes end."""

    def __init__(self, warm: Path) -> None:
        self.times: list[float] = []
        self._warm = warm

    def begin(self, title: str, tasks: int, todo: int) -> None: ...

    def advances(self, progress: object) -> None: ...

    def compiling(self) -> None: ...

    def ends(self, _outcome: object) -> None:
        self.times.append(time.time())
        if len(self.times) == WARM_UP:
            self._warm.touch()


def kitti(options: argparse.Namespace, out: Path) -> list[dict[str, object]]:
    root = options.data / "kitti_tracking"
    # only one of these sequences has sweeps here: the others are tracked from detections alone
    chosen = [f"dataset.root={root}", "dataset.require_sweeps=false", "score_flow=false"]
    chosen += ["flow=zero", "tracker=kalman", "snapshots.scenes=0"]
    if options.quick:
        chosen.append("scenes=['0012', '0013', '0014']")
    run = ("run", "kitti_flow_sources", *chosen)
    local = timed(*run, "--out", str(out / "local"), "--workers", "2")
    there = ThreeNodes(NODES)
    try:
        ray = timed(*run, "--out", str(out / "ray"), "--cluster", there.address)
    finally:
        there.stop()
    mine, theirs = results(out / "local"), results(out / "ray")
    if not mine or mine != theirs:
        raise SystemExit("the results differ, or there are none")
    return [{"sequences": len(mine), "local s": local, "three nodes s": ray, "identical": True}]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    measures = {"kills": kills, "examples": examples, "efficiency": efficiency, "kitti": kitti}
    parser.add_argument("what", choices=measures, nargs="?", default="efficiency")
    parser.add_argument("--quick", action="store_true", help="a few scenes")
    parser.add_argument("--scenes", type=int, default=60, help="of efficiency (default 60)")
    parser.add_argument(
        "--seconds", type=int, default=10, help="length of a scene of efficiency (default 10)"
    )
    parser.add_argument("--data", type=Path, help="folder with kitti_tracking", default=Path())
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        report(measures[options.what](options, Path(name)), options.json)


if __name__ == "__main__":
    main()

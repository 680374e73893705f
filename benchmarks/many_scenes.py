"""Time and memory of scoring stored scenes, against their number.

A scene of the embedded world (key frames at 2 Hz, as nuScenes) is run once. Its result is stored in
100 variants, whose tracks differ in their scores, and each is linked under as many names as asked
for; a fresh process then scores the folder of one run, or compares two with intervals. Flow samples
take most of a result, so the scene is stored with and without them.

python benchmarks/many_scenes.py --quick
python benchmarks/many_scenes.py --scenes 100 1000 10000 --runs 2
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from _common import report

from mottrack.core.tables import FlowSamples
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.pipeline.scene_run import SceneRun, run_scene
from mottrack.runs.comparison import load_comparison
from mottrack.runs.run_folder import RunFolder

VARIANTS = 100
SCORE_SPREAD = 0.01  # of the variants: enough that no two tracks have the same score


@dataclass(frozen=True)
class Source:
    experiment: Experiment
    run: SceneRun

    @classmethod
    def of(cls, tracker: str, seconds: int) -> Source:
        chosen = ("dataset.scenes=1", f"dataset.duration_s={seconds}", "flow=icp")
        (experiment,) = load_experiments("demo", (*chosen, f"tracker={tracker}"))
        dataset = experiment.dataset.make()
        scene = dataset.scene(dataset.scene_names[0])
        return cls(experiment, run_scene(experiment, scene, keep_snapshots=False))

    def store(self, folder: RunFolder, scenes: int, *, flow: bool) -> None:
        folder.reserve(self.experiment)
        for k in range(scenes):
            name, made = f"scene-{k:06d}", f"scene-{k % VARIANTS:06d}"
            if k < VARIANTS:
                folder.store(self._variant(name, k, flow=flow))
                continue
            for file in (folder.scene_file, folder.timings_file, folder.latency_file):
                os.link(file(made), file(name))

    def _variant(self, name: str, seed: int, *, flow: bool) -> SceneRun:
        tracks = self.run.result.tracks
        ids, row = np.unique(tracks.id, return_inverse=True)
        shift = np.random.default_rng(seed).uniform(0.0, SCORE_SPREAD, len(ids))
        result = replace(
            self.run.result, name=name, tracks=replace(tracks, score=tracks.score + shift[row])
        )
        if not flow:
            result = replace(result, flow=FlowSamples.empty())
        return replace(self.run, result=result, snapshots=[])


def score(folder: Path) -> None:
    """Score a folder; print wall and CPU seconds and peak memory."""
    begun, comparison = time.perf_counter(), load_comparison(folder)
    for run in comparison.runs:
        if not run.as_dict()["metrics"]["overall"]["truth_boxes"]:
            raise SystemExit(f"{folder} holds no true box")
    wall_s = time.perf_counter() - begun
    print(wall_s, time.process_time(), peak_mb())


def peak_mb() -> float:
    """Largest resident size of this process since its start; `ru_maxrss` is also the parent's."""
    status = Path("/proc/self/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1024


def rows(options: argparse.Namespace) -> Iterator[dict[str, object]]:
    trackers = ("kalman", "fixed_lag")[: options.runs]
    sources = {tracker: Source.of(tracker, options.seconds) for tracker in trackers}
    for flow in options.flow:
        for scenes in options.scenes:
            with tempfile.TemporaryDirectory(dir=options.folder) as name:
                for tracker, source in sources.items():
                    source.store(RunFolder(Path(name) / tracker), scenes, flow=flow)
                command = [sys.executable, __file__, "score", name]
                wall, cpu, peak = map(float, subprocess.check_output(command, text=True).split())
            yield {
                "scenes": scenes,
                "runs": len(trackers),
                "frames": scenes * len(sources[trackers[0]].run.result.frames),
                "flow": flow,
                "wall s": wall,
                "CPU s": cpu,
                "ms a scene and run": 1e3 * cpu / scenes / len(trackers),
                "peak MB": peak,
            }


def main() -> None:
    if len(sys.argv) == 3 and sys.argv[1] == "score":
        score(Path(sys.argv[2]))
        return
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a few scenes")
    parser.add_argument("--scenes", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--seconds", type=int, default=20, help="length of a scene")
    parser.add_argument("--runs", type=int, choices=(1, 2), default=1)
    parser.add_argument("--folder", type=Path, help="where the results are put for a while")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument(
        "--flow", choices=("with", "without", "both"), default="both", help="flow samples"
    )
    options = parser.parse_args()
    options.flow = {"with": [True], "without": [False], "both": [True, False]}[options.flow]
    if options.quick:
        options.scenes, options.seconds = [5, 20], 4
    report(list(rows(options)), options.json)


if __name__ == "__main__":
    main()

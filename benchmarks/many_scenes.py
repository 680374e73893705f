"""Time and memory of scoring stored scenes, against their number.

A scene of the embedded world (20 s, key frames at 2 Hz, as nuScenes) is run once and stored under
as many names as asked for; a fresh process then scores the folder. Flow samples take most of a
result, so the scene is stored with and without them.

python benchmarks/many_scenes.py --quick
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from _common import arguments, report

from mottrack.core.tables import FlowSamples
from mottrack.experiment.experiment import load_experiments
from mottrack.pipeline.scene_run import SceneRun, run_scene
from mottrack.runs.comparison import load_comparison
from mottrack.runs.run_folder import RunFolder

CHOSEN = ("dataset.scenes=1", "dataset.duration_s=20", "flow=icp", "tracker=kalman")


def store(run: SceneRun, folder: RunFolder, scenes: int, *, flow: bool) -> float:
    """Store the scene so many times; return the seconds for one."""
    begun = time.perf_counter()
    for k in range(scenes):
        result = replace(run.result, name=f"scene-{k:06d}")
        if not flow:
            result = replace(result, flow=FlowSamples.empty())
        folder.store(replace(run, result=result, snapshots=[]))
    return (time.perf_counter() - begun) / scenes


def score(folder: Path) -> None:
    """Score a folder; print seconds and peak memory."""
    begun = time.perf_counter()
    scores = load_comparison(folder).runs[0].scores
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if not scores.overall.clear.truth:
        raise SystemExit(f"{folder} holds no true box")
    print(time.perf_counter() - begun, peak_mb)


def main() -> None:
    if len(sys.argv) == 3 and sys.argv[1] == "score":
        score(Path(sys.argv[2]))
        return
    options = arguments(__doc__ or "")
    (experiment,) = load_experiments("demo", CHOSEN)
    dataset = experiment.dataset.make()
    run = run_scene(experiment, dataset.scene(dataset.scene_names[0]), keep_snapshots=False)
    rows = []
    for scenes in (5, 20) if options.quick else (50, 200):
        for flow in (True, False):
            with tempfile.TemporaryDirectory() as name:
                folder = RunFolder(Path(name))
                folder.reserve(experiment)
                store_s = store(run, folder, scenes, flow=flow)
                size = folder.scene_file("scene-000000").stat().st_size / 1e6
                command = [sys.executable, __file__, "score", name]
                seconds, peak = map(float, subprocess.check_output(command, text=True).split())
            row = {"scenes": scenes, "flow": flow, "MB a result": size, "s to store": store_s}
            rows.append({**row, "s to score": seconds, "peak MB": peak})
    report(rows, options.json)


if __name__ == "__main__":
    main()

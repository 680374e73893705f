"""Runs the official devkit on a folder of nuScenes-format data, as a process of its own.

    python devkit_evaluation.py DATA OUT

DATA holds v1.0-trainval/, submission.json and scenes.txt; the official files go to OUT, and the
last line printed is JSON with the CPU seconds of loading and of evaluate() alone.
"""

import json
import sys
import time
from pathlib import Path

from nuscenes.eval.common import loaders
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.tracking import evaluate as tracking
from nuscenes.utils import splits


def main(data: Path, out: Path) -> None:
    names = (data / "scenes.txt").read_text().split()
    official = splits.create_splits_scenes

    def only_these_scenes(verbose: bool = False) -> dict[str, list[str]]:
        return official(verbose) | {"val": names}

    splits.create_splits_scenes = loaders.create_splits_scenes = only_these_scenes
    began = time.process_time()
    evaluation = tracking.TrackingEval(
        config=config_factory("tracking_nips_2019"),
        result_path=str(data / "submission.json"),
        eval_set="val",
        output_dir=str(out),
        nusc_version="v1.0-trainval",
        nusc_dataroot=str(data),
        verbose=False,
        render_classes=[],
    )
    loaded = time.process_time()
    evaluation.main(render_curves=False)
    times = {"load_cpu_s": loaded - began, "evaluate_cpu_s": time.process_time() - loaded}
    sys.stdout.write(json.dumps(times) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

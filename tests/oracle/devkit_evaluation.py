"""Runs the official devkit on a folder of nuScenes-format data, as a process of its own.

    python devkit_evaluation.py DATA OUT

DATA holds v1.0-trainval/, submission.json and scenes.txt; the official files go to OUT, and the
last line printed is JSON with the CPU seconds of loading and of evaluate() alone.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

from nuscenes.eval.common import loaders
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.tracking import evaluate as tracking
from nuscenes.utils import splits

_OFFICIAL_SPLITS = splits.create_splits_scenes


def load(data: Path, out: Path) -> tracking.TrackingEval:
    """The devkit's evaluation object, for the scenes of scenes.txt in place of the split val."""
    names = (data / "scenes.txt").read_text().split()

    def only_these_scenes(verbose: bool = False) -> dict[str, list[str]]:
        return _OFFICIAL_SPLITS(verbose) | {"val": names}

    loaders.create_splits_scenes = only_these_scenes
    return tracking.TrackingEval(
        config=config_factory("tracking_nips_2019"),
        result_path=str(data / "submission.json"),
        eval_set="val",
        output_dir=str(out),
        nusc_version="v1.0-trainval",
        nusc_dataroot=str(data),
        verbose=False,
        render_classes=[],
    )


def evaluate_folder(data: Path, out: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The official summary and details of a folder."""
    load(data, out).main(render_curves=False)
    return (
        json.loads((out / "metrics_summary.json").read_text()),
        json.loads((out / "metrics_details.json").read_text()),
    )


def main(data: Path, out: Path) -> None:
    """Evaluates a folder and prints the times."""
    began = time.process_time()
    evaluation = load(data, out)
    loaded = time.process_time()
    evaluation.main(render_curves=False)
    times = {"load_cpu_s": loaded - began, "evaluate_cpu_s": time.process_time() - loaded}
    sys.stdout.write(json.dumps(times) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

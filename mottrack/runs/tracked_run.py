"""Finished runs as scenes with truth and tracks, for the evaluations that any tracks share."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from mottrack.core.errors import ResultError, require_exists
from mottrack.eval.tracked_scenes import TrackedScenes
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.comparison import variants_of
from mottrack.runs.per_scene import PerScene
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.scored_run import ScoredRun


def of_run(run: ScoredRun) -> TrackedScenes:
    """Return the finished scenes of a scored run.

    Raises:
        ResultError: a file is damaged.
    """
    results = PerScene(run.finished, partial(run.folder.load, flow=False))
    objects = PerScene(run.finished, run.folder.load_objects)
    counted = tuple(run.evaluation.filters)
    return TrackedScenes(results, run.config, objects, counted=counted)


def of_folders(paths: list[Path]) -> dict[str, TrackedScenes]:
    """Read finished runs by the names of their folders; a folder of several gives all.

    Raises:
        ResultError: a folder holds no run, or a file is damaged.
    """
    found: dict[str, TrackedScenes] = {}
    for path in paths:
        require_exists(path, "a file or folder of tracks")
        folders = [path / variant for variant in variants_of(path)]
        if not folders:
            raise ResultError(path, "content", "no run.json", "the folder of a run")
        for folder in map(RunFolder, folders):
            config = load_experiments(str(folder.config_file))[0].settings.scores
            results = PerScene(folder.scenes, partial(folder.load, flow=False))
            objects = PerScene(folder.scenes, folder.load_objects)
            found[folder.path.name] = TrackedScenes(results, config, objects)
    return found

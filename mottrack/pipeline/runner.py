"""Runs the scenes of an experiment in supervised processes, and picks up where it stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

import mottrack
from mottrack.core.errors import ConfigError, MottrackError, ResultError
from mottrack.core.result import SceneResult
from mottrack.core.storage import write_text
from mottrack.pipeline.experiment import Experiment
from mottrack.pipeline.workers import Outcome, Progress, Task, run_tasks


@dataclass(frozen=True)
class RunFolder:
    """Where an experiment keeps its configuration and the result of every scene."""

    path: Path

    @property
    def config_file(self) -> Path:
        """The resolved configuration."""
        return self.path / "config.yaml"

    @property
    def identity_file(self) -> Path:
        """Hash of the configuration and version of the code that made the results."""
        return self.path / "run.json"

    def scene_file(self, scene: str) -> Path:
        """The stored result of a scene."""
        return self.path / "scenes" / f"{_file_name(scene)}.npz"

    def timings_file(self, scene: str) -> Path:
        """Seconds per stage and frame, kept apart since they differ from run to run."""
        return self.path / "scenes" / f"{_file_name(scene)}.timings.json"

    def claim(self, experiment: Experiment) -> None:
        """Writes the configuration, or checks that the folder already belongs to it.

        Raises:
            ConfigError: the folder holds results of another configuration or version.
        """
        mine = {"config_hash": experiment.hash, "version": mottrack.__version__}
        if self.identity_file.exists():
            theirs = _read_json(self.identity_file)
            if theirs != mine:
                raise ConfigError(
                    f"{self.path} holds results of another configuration or version ({theirs}, "
                    f"this is {mine}); choose another --out or remove the folder"
                )
            return
        header = f"# resolved configuration, sha256 {experiment.hash}\n"
        text = yaml.safe_dump(experiment.resolved(), sort_keys=False, allow_unicode=True)
        write_text(self.config_file, header + text)
        write_text(self.identity_file, json.dumps(mine, indent=2) + "\n")

    def finished(self, scene: str) -> bool:
        """Whether the scene's result is there and undamaged; a damaged one is removed."""
        path = self.scene_file(scene)
        if not path.exists():
            return False
        try:
            SceneResult.load(path)
        except ResultError:
            path.unlink()
            return False
        return True

    def store(self, result: SceneResult) -> None:
        """Writes a scene's result; the result itself last, since it says that all is there."""
        seconds = {stage: values.tolist() for stage, values in result.timings_s.items()}
        write_text(self.timings_file(result.name), json.dumps(seconds))
        result.save(self.scene_file(result.name))

    def load(self, scene: str) -> SceneResult:
        """A stored result with its timings.

        Raises:
            ResultError: it is missing or damaged.
        """
        result = SceneResult.load(self.scene_file(scene))
        timings: dict[str, NDArray[np.float64]] = {}
        if self.timings_file(scene).exists():
            stored = _read_json(self.timings_file(scene))
            timings = {stage: np.array(values) for stage, values in stored.items()}
        return SceneResult(
            result.name,
            result.frames,
            result.truth,
            result.tracks,
            result.flow,
            result.hull_xy_m,
            timings,
        )


@dataclass(frozen=True)
class RunReport:
    """What became of the scenes."""

    finished: tuple[str, ...]
    failed: dict[str, str]
    """Scene to the reason, one line each."""
    resumed: int
    """How many of the finished scenes were there already."""
    wall_s: float


def run_experiment(
    experiment: Experiment, folder: RunFolder, *, workers: int, progress: Progress
) -> RunReport:
    """Runs every scene that has no result yet; one that fails does not lose the others.

    Raises:
        ConfigError: a scene is unknown, or the folder belongs to another configuration.
    """
    start = time.perf_counter()
    scenes = scene_names(experiment)
    folder.claim(experiment)
    todo = [scene for scene in scenes if not folder.finished(scene)]
    progress.begin(experiment.variant or experiment.settings.name, len(scenes), len(todo))
    tasks = [Task(experiment, scene, folder.path) for scene in todo]
    outcomes = run_tasks(tasks, scene_task, workers=workers, progress=progress)
    failed = {o.scene: o.error for o in outcomes if o.error}
    return RunReport(
        finished=tuple(scene for scene in scenes if scene not in failed),
        failed=failed,
        resumed=len(scenes) - len(todo),
        wall_s=time.perf_counter() - start,
    )


def scene_names(experiment: Experiment) -> tuple[str, ...]:
    """The scenes that the experiment asks for, in the data set's order.

    Raises:
        ConfigError: the data set has no scene, or not one that is asked for.
    """
    dataset = experiment.dataset.make()
    known: Sequence[str] = dataset.scene_names
    wanted = experiment.settings.scenes
    if wanted is None:
        if not known:
            raise ConfigError(f"data set '{dataset.name}' has no scene")
        return tuple(known)
    for scene in wanted:
        if scene not in known:
            dataset.scene(scene)  # a data set may open scenes it does not list; else it complains
    return tuple(wanted)


def scene_task(task: Task, on_frame: Callable[[int, int], None]) -> None:
    """Runs one scene and stores its result: what a worker does."""
    from mottrack.pipeline.scene_run import run_scene

    scene = task.experiment.dataset.make().scene(task.scene)
    RunFolder(task.folder).store(run_scene(task.experiment, scene, on_frame))


def _file_name(scene: str) -> str:
    if scene in ("", ".", "..") or "/" in scene or "\\" in scene or "\0" in scene:
        raise ConfigError(f"scene name {scene!r} can't be a file name")
    return scene


def _read_json(path: Path) -> dict[str, object]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ResultError(path, "content", str(error), "JSON") from error
    if not isinstance(content, dict):
        raise ResultError(path, "content", type(content).__name__, "a mapping")
    return content


__all__ = [
    "MottrackError",
    "Outcome",
    "RunFolder",
    "RunReport",
    "run_experiment",
    "scene_names",
    "scene_task",
]

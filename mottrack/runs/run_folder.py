"""The folder of a run: its configuration and the result of every scene."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from mottrack.core.errors import ConfigError, ResultError
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import save_snapshots
from mottrack.core.storage import discard_unfinished, write_text
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.latency import StepTimes
from mottrack.pipeline.scene_run import SceneRun
from mottrack.runs.fingerprint import fingerprint

RESULT, SNAPSHOTS = ".npz", ".snapshots.npz"


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
        """What made the results: see `fingerprint`."""
        return self.path / "run.json"

    def scene_file(self, scene: str) -> Path:
        """The stored result of a scene."""
        return self.path / "scenes" / f"{_file_name(scene)}{RESULT}"

    def timings_file(self, scene: str) -> Path:
        """Seconds per stage and frame, kept apart since they differ from run to run."""
        return self.path / "scenes" / f"{_file_name(scene)}.timings.json"

    def snapshots_file(self, scene: str) -> Path:
        """Points, flow and objects of its key frames, if kept: core.snapshot."""
        return self.path / "scenes" / f"{_file_name(scene)}{SNAPSHOTS}"

    def latency_file(self, scene: str) -> Path:
        """Seconds per stage of every step, key frame or not."""
        return self.path / "scenes" / f"{_file_name(scene)}.latency.json"

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of the scenes with a stored result, sorted."""
        names = (file.name for file in (self.path / "scenes").glob(f"*{RESULT}"))
        return tuple(sorted(n.removesuffix(RESULT) for n in names if not n.endswith(SNAPSHOTS)))

    def claim(self, experiment: Experiment) -> None:
        """Writes the configuration, or checks that the folder already belongs to it.

        Raises:
            ConfigError: the folder holds results of another configuration, code or weights.
            DataError: a file of weights is missing.
        """
        mine = fingerprint(experiment)
        if self.identity_file.exists():
            theirs = _read_json(self.identity_file)
            other = [what for what in (mine | theirs) if theirs.get(what) != mine.get(what)]
            if other:
                raise ConfigError(
                    f"{self.path} holds results of another {', another '.join(other)} (run.json); "
                    "choose another --out or remove the folder"
                )
            return
        header = f"# resolved configuration, sha256 {experiment.hash}\n"
        text = yaml.safe_dump(experiment.resolved(), sort_keys=False, allow_unicode=True)
        write_text(self.config_file, header + text)
        write_text(self.identity_file, json.dumps(mine, indent=2) + "\n")

    def tidy(self) -> None:
        """Removes what killed writers left."""
        discard_unfinished(self.path)
        discard_unfinished(self.path / "scenes")

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

    def store(self, run: SceneRun) -> None:
        """Writes what a scene left; the result itself last, since it says that all is there."""
        result = run.result
        if run.snapshots:
            save_snapshots(self.snapshots_file(result.name), run.snapshots)
        seconds = {stage: values.tolist() for stage, values in result.timings_s.items()}
        write_text(self.timings_file(result.name), json.dumps(seconds))
        write_text(self.latency_file(result.name), json.dumps(run.times.as_dict()))
        result.save(self.scene_file(result.name))

    def load(self, scene: str) -> SceneResult:
        """A stored result with its timings.

        Raises:
            ResultError: it is missing or damaged.
        """
        result = SceneResult.load(self.scene_file(scene))
        if not self.timings_file(scene).exists():
            return result
        stored = _read_json(self.timings_file(scene))
        return replace(result, timings_s={k: np.array(v) for k, v in stored.items()})

    def times(self, scene: str) -> StepTimes | None:
        """Times of every step; None where they were not kept.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.latency_file(scene)
        return StepTimes.of(_read_json(path), path) if path.exists() else None


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

"""The folder of a run: its configuration, what it was made with, and the result of every scene."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from mottrack.core.arrays import F64
from mottrack.core.errors import ConfigError, DataError, ResultError, require_exists, unknown_name
from mottrack.core.result import SceneResult
from mottrack.core.scene_objects import SceneObjects, load_objects, save_objects
from mottrack.core.snapshot import Snapshot, load_snapshots, save_snapshots
from mottrack.core.storage import discard_unfinished, write_text
from mottrack.eval.label_free import LabelFreeSums, load_judgement, save_judgement
from mottrack.eval.sceneflow.stored import load_sums, save_sums
from mottrack.eval.sceneflow.sums import SceneFlowSums
from mottrack.experiment.experiment import Experiment
from mottrack.formats.columns import ColumnSpec
from mottrack.formats.files import read_bytes
from mottrack.formats.json_text import parse_json
from mottrack.formats.nuscenes_tables import json_array
from mottrack.pipeline.latency import StepTimes
from mottrack.pipeline.scene_run import SceneRun
from mottrack.runs.fingerprint import fingerprint

RESULT, SNAPSHOTS, OBJECTS = ".npz", ".snapshots.npz", ".objects.npz"
SCENE_FLOW, LABEL_FREE = ".sceneflow.npz", ".labelfree.npz"
BESIDE = (SNAPSHOTS, OBJECTS, SCENE_FLOW, LABEL_FREE)
"""Files of a scene that end as its result does."""
MOST_NAME = 200
"""Characters of a scene's name: file names have 255 bytes, the suffix and a temporary name too."""
_SECONDS = ColumnSpec("seconds")


@dataclass(frozen=True)
class RunFolder:
    """Paths of a run's files, and their reading and writing."""

    path: Path

    @property
    def config_file(self) -> Path:
        """The resolved configuration."""
        return self.path / "config.yaml"

    @property
    def identity_file(self) -> Path:
        """What the results were made with: see `fingerprint`."""
        return self.path / "run.json"

    def scene_file(self, scene: str) -> Path:
        """Return the path of a scene's result."""
        return self._file(scene, RESULT)

    def timings_file(self, scene: str) -> Path:
        """Return the path of the seconds per stage and key frame, which differ between runs."""
        return self._file(scene, ".timings.json")

    def snapshots_file(self, scene: str) -> Path:
        """Return the path of points, flow and objects of key frames, if kept: core.snapshot."""
        return self._file(scene, SNAPSHOTS)

    def objects_file(self, scene: str) -> Path:
        """Return the path of what the tracker received: core.scene_objects."""
        return self._file(scene, OBJECTS)

    def scene_flow_file(self, scene: str) -> Path:
        """Return the path of the sums of the scene flow, if compared: eval.sceneflow.stored."""
        return self._file(scene, SCENE_FLOW)

    def label_free_file(self, scene: str) -> Path:
        """Return the path of the label-free sums, if the flow was judged: eval.label_free."""
        return self._file(scene, LABEL_FREE)

    def latency_file(self, scene: str) -> Path:
        """Return the path of the seconds per stage of every step, key frame or not."""
        return self._file(scene, ".latency.json")

    def _file(self, scene: str, suffix: str) -> Path:
        if scene in ("", ".", "..") or any(c in scene for c in "/\\\0") or len(scene) > MOST_NAME:
            raise ConfigError(f"scene name {scene!r} can't be a file name")
        return self.path / "scenes" / f"{scene}{suffix}"

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of the scenes with a stored result, sorted."""
        names = (file.name for file in (self.path / "scenes").glob(f"*{RESULT}"))
        return tuple(sorted(n.removesuffix(RESULT) for n in names if not n.endswith(BESIDE)))

    def reserve(self, experiment: Experiment) -> None:
        """Write the configuration, or check that the folder already belongs to it.

        Raises:
            ConfigError: the folder holds results of another configuration, code or weights.
            DataError: a file of weights is missing.
        """
        if not self.identity_file.exists():
            header = f"# resolved configuration, sha256 {experiment.hash}\n"
            text = yaml.safe_dump(experiment.resolved(), sort_keys=False, allow_unicode=True)
            write_text(self.config_file, header + text)
        claim(self.identity_file, fingerprint(experiment))

    def remove_partial(self) -> None:
        """Remove the temporary files of writers that were killed."""
        discard_unfinished(self.path)
        discard_unfinished(self.path / "scenes")

    def finished(self, scene: str) -> bool:
        """Return whether the scene's result is there and undamaged; remove a damaged one."""
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
        """Write the results of a scene; the result file last, since it marks the scene finished."""
        result = run.result
        save_objects(self.objects_file(result.name), run.objects)
        if run.scene_flow is not None:
            save_sums(self.scene_flow_file(result.name), run.scene_flow)
        if run.label_free is not None:
            save_judgement(self.label_free_file(result.name), run.label_free)
        seconds = {stage: values.tolist() for stage, values in result.timings_s.items()}
        write_text(self.timings_file(result.name), json.dumps(seconds))
        write_text(self.latency_file(result.name), json.dumps(run.times.as_dict()))
        self.store_result(result, run.snapshots)

    def store_result(self, result: SceneResult, snapshots: Sequence[Snapshot]) -> None:
        """Write a result that nobody has timed, and its key frames if there are any."""
        if snapshots:
            save_snapshots(self.snapshots_file(result.name), snapshots)
        result.save(self.scene_file(result.name))

    def files(self, scene: str) -> dict[str, bytes]:
        """Read the stored files of a scene by path within the folder; its result comes last."""
        flow = (self.scene_flow_file, self.label_free_file)
        beside = (self.snapshots_file, self.objects_file, *flow)
        paths = (self.timings_file, self.latency_file, *beside, self.scene_file)
        stored = [path for f in paths if (path := f(scene)).exists()]
        return {str(path.relative_to(self.path)): path.read_bytes() for path in stored}

    def load(self, scene: str, *, flow: bool = True) -> SceneResult:
        """Read a stored result with its timings; the samples of the flow only if asked for.

        Raises:
            ResultError: it is missing or damaged.
        """
        result = SceneResult.load(self.scene_file(scene), flow=flow)
        return replace(result, timings_s=self.timings(scene))

    def timings(self, scene: str) -> dict[str, F64]:
        """Read the seconds per stage and key frame; none where they were not stored.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.timings_file(scene)
        if not path.exists():
            return {}
        found: dict[str, F64] = {}
        for stage, values in _read_json(path).items():
            seconds = json_array(values, _SECONDS) if isinstance(values, list) else None
            if seconds is None or (seconds < 0.0).any():
                raise ResultError(path, stage, values, "a list of seconds")
            found[stage] = seconds
        return found

    @property
    def stored_hash(self) -> object:
        """The hash of the configuration that the run noted; None where it noted none."""
        if not self.identity_file.exists():
            return None
        return _read_json(self.identity_file).get("configuration")

    def load_snapshots(self, scene: str) -> list[Snapshot]:
        """Read the key frames of a scene; none where the run did not keep them.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.snapshots_file(scene)
        return load_snapshots(path) if path.exists() else []

    def load_objects(self, scene: str) -> SceneObjects | None:
        """Read what the tracker received; None where the run did not store it.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.objects_file(scene)
        return load_objects(path) if path.exists() else None

    def load_scene_flow(self, scene: str) -> SceneFlowSums | None:
        """Read the sums of the scene flow; None where it was not compared.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.scene_flow_file(scene)
        return load_sums(path) if path.exists() else None

    def load_label_free(self, scene: str) -> LabelFreeSums | None:
        """Read the label-free sums of a scene; None where its flow was not judged.

        Raises:
            ResultError: the file is damaged.
        """
        path = self.label_free_file(scene)
        return load_judgement(path) if path.exists() else None

    def times(self, scene: str) -> StepTimes:
        """Read the times of every step.

        Raises:
            ResultError: the file is missing or damaged.
        """
        path = self.latency_file(scene)
        stored = _read_json(path)
        for name, value in stored.items():
            if not _all_seconds(value):
                raise ResultError(path, name, value, "seconds, and nothing else")
        return StepTimes.of(stored, path)


def _all_seconds(value: object) -> bool:
    """Return whether every number in mappings and lists is a time, and nothing else is there."""
    if isinstance(value, dict):
        return all(map(_all_seconds, value.values()))
    if isinstance(value, list):
        return all(map(_all_seconds, value))
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and 0.0 <= value < math.inf  # type: ignore[operator]


def _read_json(path: Path) -> dict[str, object]:
    try:
        content = parse_json(path, read_bytes(path), "JSON")
    except DataError as error:
        raise ResultError(path, error.field, error.value, error.expected) from error
    if not isinstance(content, dict):
        raise ResultError(path, "content", type(content).__name__, "a mapping")
    return content


@dataclass(frozen=True)
class StoredScene:
    """The result of a scene and, where the run kept them, points and flow of its key frames."""

    result: SceneResult
    snapshots: list[Snapshot]

    @classmethod
    def load(cls, run: Path, scene: str) -> StoredScene:
        """Read one scene of a run.

        Raises:
            ResultError: a file is missing or damaged.
        """
        folder = RunFolder(run)
        return cls(folder.load(scene), folder.load_snapshots(scene))


def stored_scenes(run: Path) -> tuple[str, ...]:
    """Return the finished scenes of a run, in order; those with stored key frames first.

    Raises:
        ConfigError: the folder does not exist, or holds several runs.
        ResultError: it holds none, or no scene of it is finished.
    """
    require_exists(run, "the folder of a run")
    folder = RunFolder(run)
    if not folder.config_file.exists():
        inside = sorted(path.parent.name for path in run.glob("*/config.yaml"))
        if inside:
            raise ConfigError(f"{run} holds several runs; name one of: {', '.join(inside)}")
        raise ResultError(run, "content", "no config.yaml", "the folder of a run")
    if not folder.scenes:
        raise ResultError(run, "finished scenes", "none", "scenes/<scene>.npz")
    return tuple(sorted(folder.scenes, key=lambda name: not folder.snapshots_file(name).exists()))


def pick_scene(run: Path, scene: str | None) -> str:
    """Return the scene of that name; without a name the first one.

    Raises:
        ConfigError: the run has no such scene, or as `stored_scenes`.
        ResultError: as `stored_scenes`.
    """
    names = stored_scenes(run)
    if scene is None:
        return names[0]
    if scene not in names:
        raise unknown_name(f"scene of {run}", scene, names)
    return scene


def claim(file: Path, made_with: Mapping[str, str]) -> None:
    """Note what the results of the file's folder are made with, or compare it with the note.

    Raises:
        ConfigError: the folder holds results of another configuration, code or weights.
    """
    if not file.exists():
        write_text(file, json.dumps(dict(made_with), indent=2) + "\n")
        return
    stored = _read_json(file)
    other = [what for what in {**made_with, **stored} if stored.get(what) != made_with.get(what)]
    if other:
        raise ConfigError(
            f"{file.parent} holds results of another {', another '.join(other)} ({file.name}); "
            "choose another --out or remove the folder"
        )

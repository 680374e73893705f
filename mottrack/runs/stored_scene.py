"""What a finished run has stored of a scene, read again to be looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mottrack.core.errors import ConfigError, ResultError, unknown_name
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot, load_snapshots
from mottrack.runs.run_folder import RunFolder


@dataclass(frozen=True)
class StoredScene:
    """The result of a scene and, where the run kept them, points and flow of its key frames."""

    result: SceneResult
    snapshots: list[Snapshot]

    @classmethod
    def load(cls, run: Path, scene: str) -> StoredScene:
        """Reads one scene.

        Raises:
            ResultError: a file is missing or damaged.
        """
        folder = RunFolder(run)
        kept = folder.snapshots_file(scene)
        return cls(folder.load(scene), load_snapshots(kept) if kept.exists() else [])


def stored_scenes(run: Path) -> tuple[str, ...]:
    """Names of the finished scenes of a run, in order; those with key frames first.

    Raises:
        ConfigError: the folder holds several runs.
        ResultError: it holds none, or no scene of it is finished.
    """
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
    """The scene of that name; without a name the first one.

    Raises:
        ConfigError: the run has no such scene, or see `stored_scenes`.
    """
    names = stored_scenes(run)
    if scene is None:
        return names[0]
    if scene not in names:
        raise unknown_name(f"scene of {run}", scene, names)
    return scene

"""Runs that were stored on different days, brought together for a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mottrack.core.errors import ConfigError
from mottrack.core.result import SceneResult
from mottrack.core.tables import Table
from mottrack.experiment.stored import stored_experiment
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import RunReport
from mottrack.runs.scored_run import ScoredRun

TRUTH_TOLERANCE = 1e-6
"""Metres, radians, m/s: poses and boxes of one data set read on two machines differ by less."""


@dataclass(frozen=True)
class StoredRuns:
    """Runs reduced to the scenes that all of them have.

    runs: in the order in which they were named, the baseline first if one was named.
    scenes: that they have in common.
    alone: title to the scenes of a run that another one lacks.
    rules: title to a sentence for a run whose own rules of scoring are others than the first's.
    """

    runs: tuple[ScoredRun, ...]
    scenes: tuple[str, ...]
    alone: Mapping[str, tuple[str, ...]]
    rules: Mapping[str, str]


def load_stored_runs(folders: Sequence[Path]) -> StoredRuns:
    """Open runs, and runs inside the folders of comparisons.

    All are scored by the rules of the first one. Titles are the shortest ends of the folders'
    paths that tell them apart.

    Raises:
        ConfigError: fewer than two runs, runs on different kinds of data sets or without a scene in
            common, or a scene that is not the same in two runs.
        ResultError: a stored result is damaged.
    """
    paths = [path for folder in folders for path in _runs_in(folder)]
    if len(paths) < 2:
        raise ConfigError(
            f"{len(paths)} run in {', '.join(map(str, folders))}, expected two or more"
        )
    runs = [_run(path, title) for path, title in zip(paths, _titles(paths), strict=True)]
    first = runs[0]
    for run in runs[1:]:
        if run.dataset != first.dataset:
            raise ConfigError(
                f"{run.folder.path} is on {run.dataset}, {first.folder.path} on {first.dataset}; "
                "expected runs on the same data set"
            )
    scenes = tuple(s for s in first.finished if all(s in run.finished for run in runs))
    if not scenes:
        listed = "; ".join(f"{run.title}: {', '.join(run.finished[:3])}, ..." for run in runs)
        raise ConfigError(f"the runs have no scene in common ({listed})")
    for scene in scenes:
        for run in runs[1:]:
            _require_same(first, run, scene)
    alone = {run.title: tuple(s for s in run.finished if s not in scenes) for run in runs}
    rules = {run.title: text for run in runs[1:] if (text := _other_rules(first, run))}
    common = RunReport(scenes, {}, resumed=0)
    scored = tuple(_scored_as(first, replace(run, report=common)) for run in runs)
    return StoredRuns(scored, scenes, {t: s for t, s in alone.items() if s}, rules)


def _runs_in(folder: Path) -> list[Path]:
    if RunFolder(folder).identity_file.exists():
        return [folder]
    found = sorted(file.parent for file in folder.glob("*/run.json"))
    if not found:
        raise ConfigError(f"{folder} holds no run; expected a folder with run.json")
    return found


def _titles(paths: Sequence[Path]) -> list[str]:
    """Return the shortest ends of paths that are all different."""
    parts = [path.resolve().parts for path in paths]
    if len(set(parts)) != len(parts):
        twice = next(path for i, path in enumerate(paths) if parts[i] in parts[:i])
        raise ConfigError(f"{twice} is named twice, expected each run once")
    for length in range(1, max(map(len, parts)) + 1):
        titles = ["/".join(part[-length:]) for part in parts]
        if len(set(titles)) == len(titles):
            break
    return titles


def _run(path: Path, title: str) -> ScoredRun:
    folder = RunFolder(path)
    experiment = stored_experiment(folder.config_file, folder.stored_hash, title)
    if not folder.scenes:
        raise ConfigError(f"{path} has no finished scene")
    return ScoredRun(experiment, folder, RunReport(folder.scenes, {}, resumed=0))


def _require_same(first: ScoredRun, other: ScoredRun, scene: str) -> None:
    """Refuse two results of a scene that are not about the same frames and the same truth."""
    ours, theirs = (run.folder.load(scene, flow=False) for run in (first, other))
    reason = _difference(ours, theirs)
    if reason:
        raise ConfigError(
            f"scene {scene} is not the same in {first.folder.path} and {other.folder.path}: "
            f"{reason}; compare runs with the same settings of the data set"
        )


def _difference(a: SceneResult, b: SceneResult) -> str:
    if len(a.frames) != len(b.frames):
        return f"{len(a.frames)} and {len(b.frames)} frames"
    if not np.array_equal(a.frames.stamp_ns, b.frames.stamp_ns):
        return "frames at other times"
    if len(a.truth) != len(b.truth):
        return f"{len(a.truth)} and {len(b.truth)} true boxes"
    for name in a.truth.COLUMNS:
        if not _same(a.truth, b.truth, name):
            return f"{name} of the true boxes differ"
    return ""


def _same(a: Table, b: Table, name: str) -> bool:
    one, other = getattr(a, name), getattr(b, name)
    if one.dtype.kind != "f":
        return bool(np.array_equal(one, other))
    return bool(np.allclose(one, other, rtol=0.0, atol=TRUTH_TOLERANCE, equal_nan=True))


def _other_rules(first: ScoredRun, run: ScoredRun) -> str:
    """Return a sentence on the rules of a run that are not the first's."""
    ours, theirs = (r.config.model_dump(mode="json") for r in (first, run))
    other = [
        f"{name} {theirs[name]} (here {ours[name]})" for name in ours if ours[name] != theirs[name]
    ]
    return f"scored by the rules of {first.title}; its own are: {', '.join(other)}" if other else ""


def _scored_as(first: ScoredRun, run: ScoredRun) -> ScoredRun:
    settings = run.experiment.settings.model_copy(update={"scores": first.config})
    return replace(run, experiment=replace(run.experiment, settings=settings))

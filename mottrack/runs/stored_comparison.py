"""A comparison read back from its folder: nothing runs, everything is scored anew."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mottrack.core.errors import ConfigError, ResultError
from mottrack.experiment.experiment import Experiment, compose
from mottrack.experiment.yaml_file import read_yaml
from mottrack.runs.comparison import Comparison, ScoredRun, scored_run
from mottrack.runs.differences import find_differences
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import RunReport


def load_comparison(folder: Path, baseline: str | None = None) -> Comparison:
    """Reads the runs of a folder that ``mottrack run`` or ``compare`` wrote.

    Args:
        folder: of one run, or of several in a folder each.
        baseline: title of the run that the others are compared with, or part of it; the first.

    Raises:
        ConfigError: the folder holds no run with a finished scene.
        ResultError: a stored result is damaged.
    """
    notes = _notes(folder)
    runs = [_load_run(folder, variant, notes.get(variant, {})) for variant in _variants(folder)]
    runs = [run for run in runs if run.report.finished]
    if not runs:
        raise ConfigError(f"{folder} holds no finished scene of any run; expected a folder that "
                          "mottrack run or compare wrote")  # fmt: skip
    differences = find_differences([run.run_input() for run in runs], baseline)
    return Comparison(tuple(runs), folder, differences)


def _variants(folder: Path) -> list[str]:
    """Names of the runs, in the order of the comparison; "" where the folder is a run itself."""
    if RunFolder(folder).identity_file.exists():
        return [""]
    there = sorted(file.parent.name for file in folder.glob("*/run.json"))
    listed = [variant for variant in _notes(folder) if variant in there]
    return listed + [variant for variant in there if variant not in listed]


def _notes(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Variant to what scores.json says of it; nothing where a comparison was cut short."""
    path = folder / "scores.json"
    if not path.exists():
        return {}
    try:
        return {run["variant"]: run for run in json.loads(path.read_text())["runs"]}
    except (ValueError, KeyError, TypeError) as error:
        raise ResultError(path, "content", repr(error), "figures of a comparison") from error


def _load_run(folder: Path, variant: str, note: Mapping[str, Any]) -> ScoredRun:
    run = RunFolder(folder / variant)
    failed = dict(note.get("failed", {}))
    report = RunReport(finished=_scenes(run, note), failed=failed, resumed=0, wall_s=0.0)
    return scored_run(_experiment(run, variant), run, report)


def _experiment(run: RunFolder, variant: str) -> Experiment:
    resolved = compose(read_yaml(run.config_file), [], run.config_file)
    return replace(resolved[0], variant=variant)


def _scenes(run: RunFolder, note: Mapping[str, Any]) -> tuple[str, ...]:
    """Scenes with a result, in the order of the data set as far as it is known."""
    listed = [scene for scene in note.get("scenes", ()) if scene in run.scenes]
    return (*listed, *(scene for scene in run.scenes if scene not in listed))

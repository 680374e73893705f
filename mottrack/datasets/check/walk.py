"""Telling what kind of data set a folder holds, and checking its scenes side by side."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from mottrack.core import ConfigError, Dataset, MottrackError
from mottrack.core.processes import end_with_parent
from mottrack.datasets.check.findings import CheckResult, SceneCheck
from mottrack.datasets.check.scene_check import check_scene

MARKS = {
    "nuscenes": "v1.0-*",
    "kitti": "*/label_02",
    "argoverse2": "*/*/city_SE3_egovehicle.feather",
    "folder": "*/poses.csv",
    "ros": "*.mcap",
}
"""A name that only a data set of this kind has."""


@dataclass(frozen=True)
class Walk:
    """How thoroughly to walk: every `every`-th sweep, in so many processes."""

    every: int = 1
    workers: int = 1


def check_dataset(dataset: Dataset, walk: Walk) -> CheckResult:
    """Check every scene; a fault that all scenes share, as in a table, is reported once."""
    names = dataset.scene_names
    shared = _shared_fault(dataset, names)
    if shared is not None:
        return CheckResult(dataset.name, (shared,))
    workers = min(walk.workers, len(names))
    run = partial(_check_named, dataset, walk.every)
    if workers == 1:
        return CheckResult(dataset.name, tuple(map(run, names)))
    with ProcessPoolExecutor(workers, get_context("spawn"), end_with_parent) as pool:
        return CheckResult(dataset.name, tuple(pool.map(run, names)))


def _shared_fault(dataset: Dataset, names: tuple[str, ...]) -> SceneCheck | None:
    """The fault that keeps the first two scenes from opening, if it is one and the same."""
    faults: list[MottrackError] = []
    for name in names[:2]:
        try:
            dataset.scene(name)
        except MottrackError as error:
            faults.append(error)
    if len(faults) < 2 or str(faults[0]) != str(faults[1]):
        return None
    check = SceneCheck("every scene")
    check.add_error(faults[0])
    return check


def _check_named(dataset: Dataset, every: int, name: str) -> SceneCheck:
    try:
        return check_scene(dataset.scene(name), every)
    except MottrackError as error:
        check = SceneCheck(name)
        check.add_error(error)
        return check


def kind_of_folder(root: Path) -> str:
    """Return the kind of data set that a folder holds, by its layout.

    Raises:
        ConfigError: it looks like none.
    """
    for kind, pattern in MARKS.items():
        if next(root.glob(pattern), None) is not None:
            return kind
    raise ConfigError(
        f"{root} looks like no known data set: name its --format ({', '.join(MARKS)})"
    )

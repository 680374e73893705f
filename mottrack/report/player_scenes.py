"""Selection of the scenes that the page's player shows: as many as fit into the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mottrack.report.analysis import Analysis
from mottrack.report.player_data import RunData, SharedData
from mottrack.report.ranking import ReportRun
from mottrack.report.scene_errors import scene_errors


@dataclass(frozen=True)
class PackedScene:
    """One scene, packed for the page."""

    dataset: str
    scene: str
    shared: str
    """`SharedData`, packed."""
    runs: dict[int, str]
    """Index of a run to its `RunData`, packed."""

    @property
    def size(self) -> int:
        """Number of characters in the page."""
        return len(self.shared) + sum(map(len, self.runs.values()))


@dataclass(frozen=True)
class SceneSelection:
    """The scenes that are shown, and why the others are not."""

    scenes: tuple[PackedScene, ...]
    too_large: tuple[str, ...]
    """Scenes that do not fit into the page."""
    not_kept: tuple[str, ...]
    """Scenes of which no run has kept snapshots."""


def select_scenes(
    runs: Sequence[ReportRun], analyses: Sequence[Analysis], max_bytes: float
) -> SceneSelection:
    """Pack one scene after the other until the page is full."""
    names = dict.fromkeys(
        (run.scored.experiment.dataset.kind, scene)
        for run in runs
        for scene in run.scored.report.finished
    )
    scenes: list[PackedScene] = []
    too_large, not_kept = [], []
    room = max_bytes
    for dataset, scene in names:
        kept = [run for run in runs if _has_snapshots(run, dataset, scene)]
        if not kept:
            not_kept.append(scene)
        elif room <= 0:
            too_large.append(scene)
        else:
            packed = _packed(scene, kept, analyses)
            room -= packed.size
            if room > 0:
                scenes.append(packed)
            else:
                too_large.append(scene)
    return SceneSelection(tuple(scenes), tuple(too_large), tuple(not_kept))


def _has_snapshots(run: ReportRun, dataset: str, scene: str) -> bool:
    scored = run.scored
    same = scored.experiment.dataset.kind == dataset
    kept = same and scored.folder.snapshots_file(scene).exists()
    return kept and scene in scored.report.finished


def _packed(scene: str, runs: Sequence[ReportRun], analyses: Sequence[Analysis]) -> PackedScene:
    snapshots = [run.scored.folder.load_snapshots(scene) for run in runs]
    shared = SharedData(runs[0].scored.folder.load(scene), snapshots[0])
    packed: dict[int, str] = {}
    for run, kept in zip(runs, snapshots, strict=True):
        result = run.scored.folder.load(scene)
        config = run.scored.experiment.settings.scores
        filters = analyses[run.index].classes.filters if run.has_truth else ()
        errors = scene_errors(result.where_labelled(), filters, config)
        packed[run.index] = RunData(shared, result, kept, errors).packed()
    dataset = runs[0].scored.experiment.dataset.kind
    return PackedScene(dataset, scene, shared.packed(), packed)


def contents(selection: SceneSelection, runs: Sequence[ReportRun]) -> list[dict[str, Any]]:
    """Return what the page's scripts must know to find a packed scene."""
    several = len({packed.dataset for packed in selection.scenes}) > 1
    return [
        {
            "key": packed.scene,
            "name": f"{packed.dataset}: {packed.scene}" if several else packed.scene,
            "runs": [
                {
                    "index": run.index,
                    "title": run.title,
                    "flows": not run.oracle and run.measures_flow,
                    "clusters": run.clusters,
                }
                for run in runs
                if run.index in packed.runs
            ],
        }
        for packed in selection.scenes
    ]

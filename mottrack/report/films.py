"""Which scenes the page shows moving: as many as fit into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot, load_snapshots
from mottrack.report.analysis import Analysis
from mottrack.report.film import RunFilm, SceneStage
from mottrack.report.ranking import ReportRun
from mottrack.report.scene_errors import scene_errors


@dataclass(frozen=True)
class PackedScene:
    """One scene, packed for the page."""

    dataset: str
    scene: str
    stage: str
    runs: dict[int, str]
    """Index of a run to what it made of the scene."""

    @property
    def size(self) -> int:
        """Characters of the page that it takes."""
        return len(self.stage) + sum(map(len, self.runs.values()))


@dataclass(frozen=True)
class SceneSelection:
    """The scenes that are shown, and why the others are not."""

    reels: tuple[PackedScene, ...]
    too_large: tuple[str, ...]
    """Scenes for which there was no room."""
    not_kept: tuple[str, ...]
    """Scenes whose key frames no run has kept."""


def programme(
    entrants: Sequence[ReportRun], analyses: Sequence[Analysis], max_bytes: float
) -> SceneSelection:
    """Packs scene after scene until the page is full."""
    scenes = dict.fromkeys(
        (e.run.experiment.dataset.kind, scene) for e in entrants for scene in e.run.report.finished
    )
    reels: list[PackedScene] = []
    too_large, not_kept = [], []
    room = max_bytes
    for dataset, scene in scenes:
        filmed = _filmed(entrants, dataset, scene)
        if not filmed:
            not_kept.append(scene)
        elif room <= 0:
            too_large.append(scene)
        else:
            reel = _reel(dataset, scene, filmed, analyses)
            room -= reel.size
            if room > 0:
                reels.append(reel)
            else:
                too_large.append(scene)
    return SceneSelection(tuple(reels), tuple(too_large), tuple(not_kept))


def _filmed(
    entrants: Sequence[ReportRun], dataset: str, scene: str
) -> list[tuple[ReportRun, list[Snapshot]]]:
    filmed = []
    for entrant in entrants:
        run = entrant.run
        path = run.folder.snapshots_file(scene)
        ours = run.experiment.dataset.kind == dataset and scene in run.report.finished
        if ours and path.exists():
            filmed.append((entrant, load_snapshots(path)))
    return filmed


def _reel(
    dataset: str,
    scene: str,
    filmed: Sequence[tuple[ReportRun, list[Snapshot]]],
    analyses: Sequence[Analysis],
) -> PackedScene:
    first, snapshots = filmed[0]
    stage = SceneStage(first.run.load(scene), snapshots)
    runs: dict[int, str] = {}
    for entrant, kept in filmed:
        result = entrant.run.load(scene)
        config = entrant.run.experiment.settings.scores
        cuts = analyses[entrant.index].cuts if entrant.has_truth else ()
        errors = scene_errors(entrant.run.memo(SceneResult.where_labelled, result), cuts, config)
        runs[entrant.index] = RunFilm(stage, result, kept, errors).packed()
    return PackedScene(dataset, scene, stage.packed(), runs)


def contents(
    reels: Sequence[PackedScene], entrants: Sequence[ReportRun]
) -> list[dict[str, object]]:
    """What the page's scripts need know to find a reel."""
    several = len({reel.dataset for reel in reels}) > 1
    return [
        {
            "name": f"{reel.dataset}: {reel.scene}" if several else reel.scene,
            "runs": [
                {"index": e.index, "title": e.title, "flows": not e.oracle and e.measures_flow}
                for e in entrants
                if e.index in reel.runs
            ],
        }
        for reel in reels
    ]

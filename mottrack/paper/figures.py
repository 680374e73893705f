"""The figures of the paper, drawn from stored snapshots and results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mottrack.core.snapshot import Snapshot, load_snapshots
from mottrack.paper.ball_figure import draw_ball
from mottrack.paper.plan import WORLD
from mottrack.paper.published import ICP, LABELS, NONE, OGM, PILLARFLOW
from mottrack.paper.results import Results, StudyResult
from mottrack.runs.run_folder import StoredScene
from mottrack.viz.flow_comparison import FlowPanel, flow_comparison
from mottrack.viz.tracker_integration import IntegrationPanel, draw_integration

TRUTH = "ground_truth"
TITLES = {NONE: "without flow", PILLARFLOW: "with PillarFlow"}
SCENES_SHOWN = 2  # as in the paper
DPI = 130  # legible at the width of a page, 0.2 MB per figure
MOVING_MPS = 1.0
"""Cells with more speed count when scenes are chosen: above the noise of every flow source."""


@dataclass(frozen=True)
class Picture:
    """A drawn figure."""

    file: Path
    caption: str


def draw_figures(results: Results, out: Path) -> list[Picture]:
    """Draw every figure whose runs exist as PNG files in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    pictures = []
    for name, (study, draw) in FIGURES.items():
        found = results.find(WORLD, study)
        drawn = None if found is None else draw(found)
        if drawn is not None:
            figure, caption = drawn
            figure.savefig(out / f"{name}.png", dpi=DPI, metadata={"Software": None})
            pictures.append(Picture(out / f"{name}.png", caption))
    return pictures


Drawn = tuple[Figure, str] | None


def _flow_example(study: StudyResult) -> Drawn:
    scenes = _busy_scenes(study, PILLARFLOW, 1)
    if not scenes:
        return None
    shot = _last_snapshot(study, PILLARFLOW, scenes[0])
    figure = flow_comparison([[FlowPanel(LABELS[PILLARFLOW], shot)]])
    caption = (
        "Figure 1, flow example. PillarFlow between two sweeps of the embedded world from above, "
        f"scene {scenes[0]}, the one with most moving cells; colour is direction, no detections "
        "are used."
    )
    return figure, caption


def _qualitative(study: StudyResult) -> Drawn:
    variants = [v for v in (TRUTH, ICP, OGM, PILLARFLOW) if v in study.folders]
    scenes = _busy_scenes(study, TRUTH, SCENES_SHOWN)
    if not scenes:
        return None
    lines = [
        [FlowPanel(LABELS[v], _last_snapshot(study, v, scene)) for v in variants]
        for scene in scenes
    ]
    caption = (
        "Figure 3, qualitative results. From left to right: true flow, ICP + Det., Binary OGM, "
        f"PillarFlow; scenes {' and '.join(scenes)}, those with most moving cells."
    )
    return flow_comparison(lines), caption


def _integration(study: StudyResult) -> Drawn:
    objects = {s: len(_last_snapshot(study, NONE, s).objects) for s in _scenes(study, NONE)}
    if not objects:
        return None
    scene = max(objects, key=lambda name: objects[name])
    panels = []
    for variant in (NONE, PILLARFLOW):
        result = study.folders[variant].load(scene)
        shot = _last_snapshot(study, variant, scene)
        panels.append(IntegrationPanel(_capital(TITLES[variant]), result, shot))
    caption = (
        "Figure 4, tracker integration. Clusters and the fixed-lag smoother without velocities "
        f"and with PillarFlow's at the last frame of scene {scene}, the one with most clusters: "
        "green lines are the flow of cells, red ones the velocities of tracks, each as long as the "
        "displacement in one second. Static objects should have no red line."
    )
    return draw_integration(panels), caption


def _ball(study: StudyResult) -> Drawn:
    scenes = _scenes(study, PILLARFLOW)
    if not scenes:
        return None
    folders = {TITLES[variant]: study.folders[variant].path for variant in (NONE, PILLARFLOW)}
    drawn = draw_ball({t: StoredScene.load(path, scenes[0]) for t, path in folders.items()})
    if drawn is None:
        return None
    figure, told = drawn
    caption = (
        "Figure 5, out-of-ontology object (the paper throws a ball, which neither the detector nor "
        f"the labels know). {told}"
    )
    return figure, caption


FIGURES: dict[str, tuple[str, Callable[[StudyResult], Drawn]]] = {
    "figure_1_flow_example": ("flow", _flow_example),
    "figure_3_qualitative": ("flow", _qualitative),
    "figure_4_tracker_integration": ("velocity", _integration),
    "figure_5_ball": ("ball", _ball),
}


def _scenes(study: StudyResult, variant: str) -> list[str]:
    """List the scenes of which every run has kept snapshots."""
    folder = study.folders.get(variant)
    scenes = () if folder is None else folder.scenes
    folders = study.folders.values()
    return [scene for scene in scenes if all(f.snapshots_file(scene).exists() for f in folders)]


def _busy_scenes(study: StudyResult, variant: str, count: int) -> list[str]:
    shots = {scene: _last_snapshot(study, variant, scene) for scene in _scenes(study, variant)}
    moving = {s: np.sum(np.hypot(*shot.velocity_mps.T) > MOVING_MPS) for s, shot in shots.items()}
    return sorted(moving, key=lambda scene: (-moving[scene], scene))[:count]


def _last_snapshot(study: StudyResult, variant: str, scene: str) -> Snapshot:
    return load_snapshots(study.folders[variant].snapshots_file(scene))[-1]


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]

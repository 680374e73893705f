"""Sections of the report on where trackers fail: scene flow, capabilities, slices, scores, labels.

Each has data and a template of its own; the page includes them all in one place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import urlencode

from mottrack.core.arrays import F64
from mottrack.eval.capabilities.curves import curves
from mottrack.eval.capabilities.tracking import of_scenes
from mottrack.eval.label_errors.report import HEADS, suspect_table
from mottrack.eval.label_errors.suspects import Suspect, suspects
from mottrack.eval.paired import RESAMPLES, draw
from mottrack.eval.slices.calibration import Calibration, calibrations
from mottrack.eval.slices.calibration_report import calibration_table
from mottrack.eval.slices.report import DEFAULT_COLUMNS, slice_tables, sliced
from mottrack.eval.tracked_scenes import TrackedScenes
from mottrack.formats.text_table import TextTable
from mottrack.report.capability_panels import capability_panels
from mottrack.report.panels import Panel, Series, Value
from mottrack.report.player_data import MAX_FRAMES
from mottrack.report.ranking import ReportRun
from mottrack.runs.label_free import label_free_table
from mottrack.runs.scene_flow import scene_flow_tables
from mottrack.runs.tracked_run import of_run

MOST_SUSPECTS = 40
"""Probable label errors of a run that are listed: more than anybody looks at in one sitting."""
SECTIONS = {
    "scene-flow": "Scene flow",
    "label-free": "Flow without labels",
    "capabilities": "Capabilities",
    "slices": "Slices",
    "calibration": "Scores",
    "label-errors": "Labels",
}
"""Anchors and names of the sections."""


class Suspected(NamedTuple):
    """A probable label error and the place of the player where it can be seen."""

    cells: list[str]
    link: str
    """Part of an address after #; empty where the page does not show the scene."""


class SuspectsOfRun(NamedTuple):
    """Probable label errors of one run."""

    title: str
    rows: list[Suspected]
    left_out: int
    """How many are not listed."""
    reason: str
    """Why none can be sought; empty otherwise."""


def evaluation_sections(runs: Sequence[ReportRun], shown: Sequence[str]) -> dict[str, Any]:
    """Return the content of all sections of a report; those without any data are empty.

    Args:
        runs: the finished ones.
        shown: names of the scenes that the player shows.
    """
    known = {run.title: of_run(run.scored) for run in runs if run.has_truth}
    scored = [run.scored for run in runs]
    flow = FlowTables(scene_flow_tables(scored), label_free_table(scored))
    indices = {run.title: run.index for run in runs}
    return tracked_sections(known, flow, Player(tuple(shown), indices))


class FlowTables(NamedTuple):
    """Tables of the flow of runs; none of tracks alone."""

    scene_flow: Sequence[TextTable] = ()
    label_free: TextTable | None = None


class Player(NamedTuple):
    """What the player of a page shows."""

    scenes: tuple[str, ...] = ()
    runs: Mapping[str, int] = {}
    """Title of a run to its number."""


def tracked_sections(
    known: dict[str, TrackedScenes], flow: FlowTables, player: Player
) -> dict[str, Any]:
    """Return the content of all sections for tracks of any kind.

    Args:
        known: name to scenes with tracks and truth.
        flow: tables of the flow of runs.
        player: where single boxes can be seen.
    """
    content: dict[str, Any] = {
        "scene_flow": flow.scene_flow,
        "label_free": flow.label_free,
        "capabilities": capability_panels(
            {title: curves(of_scenes(scenes), RESAMPLES) for title, scenes in known.items()}
        ),
        "slices": slice_tables(sliced(known, DEFAULT_COLUMNS, RESAMPLES)) if known else [],
        "suspects": [_suspects(title, scenes, player) for title, scenes in known.items()],
        **_calibration(known),
    }
    filled = {
        "scene-flow": content["scene_flow"],
        "label-free": content["label_free"],
        "capabilities": content["capabilities"],
        "slices": content["slices"],
        "calibration": known,
        "label-errors": known,
    }
    named = {anchor: name for anchor, name in SECTIONS.items() if filled[anchor]}
    names = {"evaluation_names": named, "evaluated": list(known), "suspect_heads": HEADS}
    return {"evaluations": content, **names}


def _calibration(known: dict[str, TrackedScenes]) -> dict[str, Any]:
    found = {
        title: calibrations(scenes, draw(len(scenes.results), RESAMPLES))
        for title, scenes in known.items()
    }
    table: TextTable | None = calibration_table(found) if found else None
    drawn = [
        Series(index, title, _reliability(run[0]))
        for index, (title, run) in enumerate(found.items())
        if not isinstance(run, str)
    ]
    return {"calibration": table, "reliability": reliability_panel(drawn) if drawn else None}


def reliability_panel(series: Sequence[Series]) -> Panel:
    """Return the plot of the share of right boxes over their score, with the line of equality."""
    return Panel(
        title="Reliability",
        x_label="mean score of the bin",
        y_label="share of the track boxes that are right",
        series=series,
        ticks=[(k / 5, f"{k / 5:g}") for k in range(6)],
        x_end=1.0,
        y_end=1.0,
        diagonal=True,
    )


def _reliability(found: Calibration) -> list[Value]:
    return [
        Value(
            one.score,
            one.right.value,
            one.right.interval(),
            f"score {one.score:.2f}: {one.right.value:.3f} right of {one.boxes} boxes",
        )
        for one in found.bins
        if one.boxes
    ]


def _suspects(title: str, scenes: TrackedScenes, player: Player) -> SuspectsOfRun:
    found = suspects(scenes)
    if isinstance(found, str):
        return SuspectsOfRun(title, [], 0, found)
    listed = found[:MOST_SUSPECTS]
    cells = suspect_table(title, listed).texts()
    origins = [result.frames.world_T_ego[0, :2, 3].copy() for result in scenes.results]
    rows = [
        Suspected(row, _link(one, title, origins[one.scene_index], player))
        for one, row in zip(listed, cells, strict=True)
    ]
    return SuspectsOfRun(title, rows, len(found) - len(listed), "")


def _link(one: Suspect, title: str, origin_m: F64, player: Player) -> str:
    """Return the place in the player; positions there count from the start of the vehicle."""
    if one.scene not in player.scenes or one.frame >= MAX_FRAMES:
        return ""
    x, y = (round(a - float(b), 2) for a, b in zip(one.xy_m, origin_m, strict=True))
    place = {"scene": one.scene, "run": player.runs[title], "frame": one.frame, "x": x, "y": y}
    return urlencode(place)

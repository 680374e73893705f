"""The paper's Figure 4: green flow vectors per cell, red velocities per object, from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from mottrack.core.arrays import F64
from mottrack.core.errors import InputError
from mottrack.core.motion import FlowField
from mottrack.core.objects import Tracks
from mottrack.core.sweep import Sweep

_GREEN, _RED, _POINTS, _HULLS = "#1a9641", "#d7191c", "#b8b8b8", "#4575b4"
_SHOWN_MPS = 0.3  # slower lines are shorter than the points drawn beside them


@dataclass(frozen=True)
class IntegrationPanel:
    """One panel: the tracks with one flow source, or without."""

    title: str
    sweep: Sweep
    tracks: Tracks
    """World frame."""
    field: FlowField | None = None
    """The flow of the same sweep; None where the tracker had none."""


def draw_integration(
    panels: Sequence[IntegrationPanel], reach_m: float = 40.0, seconds: float = 1.0
) -> Figure:
    """Draw panels side by side, ego frame, x to the right.

    A line of `seconds` times the velocity starts at each measured cell (green) and at each
    track (red); speeds under 0.3 m/s are not drawn.

    Raises:
        InputError: there is no panel, or tracks are not in the world frame.
    """
    if not panels:
        raise InputError("panels", "[]", "at least one")
    figure = Figure(figsize=(8.0 * len(panels), 8.4), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, panel in zip(axes, panels, strict=True):
        _draw(axis, panel, reach_m, seconds)
    return figure


def _draw(axis: Axes, panel: IntegrationPanel, reach_m: float, seconds: float) -> None:
    if panel.tracks.frame != "world":
        raise InputError("frame of tracks", repr(panel.tracks.frame), "'world'")
    xyz_m = panel.sweep.xyz_m
    near = np.abs(xyz_m[:, :2]).max(axis=1) < reach_m
    axis.scatter(xyz_m[near, 0], xyz_m[near, 1], s=0.15, c=_POINTS, linewidths=0)
    if panel.field is not None:
        axis.add_collection(_flow_lines(panel.field, seconds))
    tracks = panel.tracks.transformed(panel.sweep.world_T_ego.inverse(), "ego")
    if tracks.hull is not None:
        axis.add_collection(
            PolyCollection(list(tracks.hull), facecolors="none", edgecolors=_HULLS, linewidths=0.8)
        )
    start_m, velocity_mps = tracks.centre_m[:, :2], tracks.velocity_mps
    axis.add_collection(_lines(start_m, velocity_mps, seconds, _RED, 2.0))
    moving = np.hypot(*velocity_mps.T) > _SHOWN_MPS
    axis.plot(0, 0, marker=">", color="black", markersize=7)
    axis.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), aspect="equal")
    axis.set_xlabel("x forward, m")
    axis.set_ylabel("y left, m")
    share = f"{int(moving.sum())} of {len(tracks)} tracks move over {_SHOWN_MPS} m/s"
    axis.set_title(f"{panel.title}\n{share}")


def _flow_lines(field: FlowField, seconds: float) -> LineCollection:
    measured = field.valid & field.occupied
    start_m = field.grid.centres_m()[measured]
    return _lines(start_m, field.velocity_mps[measured].astype(np.float64), seconds, _GREEN, 0.5)


def _lines(
    start_m: F64, velocity_mps: F64, seconds: float, colour: str, linewidth: float
) -> LineCollection:
    moving = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) > _SHOWN_MPS
    start_m, velocity_mps = start_m[moving], velocity_mps[moving]
    ends = np.stack([start_m, start_m + seconds * velocity_mps], axis=1)
    return LineCollection(list(ends), colors=colour, linewidths=linewidth)

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
from mottrack.core.pose import Pose, rotation_2d
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.viz.bev import hulls_of

_GREEN, _RED, _POINTS, _HULLS = "#1a9641", "#d7191c", "#b8b8b8", "#4575b4"
_SHOWN_MPS = 0.3  # slower lines are shorter than the points drawn beside them


@dataclass(frozen=True)
class IntegrationPanel:
    """One panel: the tracks of a key frame with one flow source, or without."""

    title: str
    result: SceneResult
    snapshot: Snapshot
    """Points and flow of the key frame that is drawn."""


def draw_integration(
    panels: Sequence[IntegrationPanel], reach_m: float = 40.0, seconds: float = 1.0
) -> Figure:
    """Draw panels side by side, ego frame, x to the right.

    A line of `seconds` times the velocity starts at each measured cell (green) and at each
    track (red); speeds under 0.3 m/s are not drawn.

    Raises:
        InputError: there is no panel.
    """
    if not panels:
        raise InputError("panels", "[]", "at least one")
    figure = Figure(figsize=(8.0 * len(panels), 8.4), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, panel in zip(axes, panels, strict=True):
        _draw(axis, panel, reach_m, seconds)
    return figure


def _draw(axis: Axes, panel: IntegrationPanel, reach_m: float, seconds: float) -> None:
    result, snapshot = panel.result, panel.snapshot
    x_m, y_m = snapshot.xyz_m[np.abs(snapshot.xyz_m[:, :2]).max(axis=1) < reach_m, :2].T
    axis.scatter(x_m, y_m, s=0.15, c=_POINTS, linewidths=0)
    measured = snapshot.valid
    flow_mps = snapshot.velocity_mps[measured].astype(np.float64)
    axis.add_collection(_lines(snapshot.xy_m[measured], flow_mps, seconds, _GREEN, 0.5))
    ego_T_world = Pose.from_matrix(result.frames.world_T_ego[snapshot.frame]).inverse()
    rows = np.flatnonzero(result.tracks.frame == snapshot.frame)
    outlined = rows[result.tracks.hull_corners[rows] > 0]
    hulls = [
        ego_T_world.apply(np.pad(hull, ((0, 0), (0, 1)), constant_values=z_m))[:, :2]
        for hull, z_m in zip(
            hulls_of(result, outlined), result.tracks.centre_m[outlined, 2], strict=True
        )
    ]
    outlines = PolyCollection(hulls, facecolors="none", edgecolors=_HULLS, linewidths=0.8)
    axis.add_collection(outlines)
    start_m = ego_T_world.apply(result.tracks.centre_m[rows])[:, :2]
    velocity_mps = result.tracks.velocity_mps[rows] @ rotation_2d(ego_T_world.yaw_rad).T
    axis.add_collection(_lines(start_m, velocity_mps, seconds, _RED, 2.0))
    moving = np.hypot(*velocity_mps.T) > _SHOWN_MPS
    axis.plot(0, 0, marker=">", color="black", markersize=7)
    axis.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), aspect="equal")
    axis.set_xlabel("x forward, m")
    axis.set_ylabel("y left, m")
    share = f"{int(moving.sum())} of {len(rows)} tracks move over {_SHOWN_MPS} m/s"
    axis.set_title(f"{panel.title}\n{share}")


def _lines(
    start_m: F64, velocity_mps: F64, seconds: float, colour: str, linewidth: float
) -> LineCollection:
    moving = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) > _SHOWN_MPS
    start_m, velocity_mps = start_m[moving], velocity_mps[moving]
    ends = np.stack([start_m, start_m + seconds * velocity_mps], axis=1)
    return LineCollection(list(ends), colors=colour, linewidths=linewidth)

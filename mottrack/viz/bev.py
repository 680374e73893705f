"""The bird's-eye view of one frame: points, flow, boxes, ids and velocities, in the ego frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import FancyArrow
from matplotlib.patheffects import withStroke

from mottrack.core.arrays import F32, F64, I64
from mottrack.core.pose import Pose, rotation_2d
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.viz.colour_wheel import bold_flow_to_rgb

FULL_COLOUR_MPS = 15.0
STILL_MPS = 0.3
"""A slower cell is drawn in grey, at rest."""
MOST_POINTS, FEW_POINTS = 40_000, 10_000
TRUTH_COLOUR, TRACK_COLOUR, POINT_COLOUR = "#2e9e5b", "#c2410c", "#9ca3af"

NUMBER: dict[str, Any] = {
    "fontsize": 7,
    "color": TRACK_COLOUR,
    "clip_on": True,
    "zorder": 6,
    "xytext": (3, 3),
    "textcoords": "offset points",
    "path_effects": [withStroke(linewidth=2, foreground="white")],
}


def draw_bev(axes: Axes, result: SceneResult, snapshot: Snapshot, *, reach_m: float) -> None:
    """Draws one key frame of a scene.

    Args:
        axes: where to draw.
        result: of the scene; its rows of the snapshot's frame are drawn.
        snapshot: points and flow of that frame.
        reach_m: half the width of the picture.
    """
    ego_T_world = Pose.from_matrix(result.frames.world_T_ego[snapshot.frame]).inverse()
    draw_points(axes, snapshot.xyz_m)
    draw_flow(axes, snapshot)
    truth = result.truth.select(result.truth.frame == snapshot.frame)
    draw_boxes(axes, truth, ego_T_world, TRUTH_COLOUR, linewidth=1.6)
    rows = np.flatnonzero(result.tracks.frame == snapshot.frame)
    tracks = result.tracks.select(rows)
    boxes = tracks.select(tracks.hull_corners == 0)
    draw_boxes(axes, boxes, ego_T_world, TRACK_COLOUR, linewidth=0.8)
    draw_hulls(axes, hulls_of(result, rows), ego_T_world)
    draw_velocities(axes, tracks, ego_T_world)
    frame_axes(axes, reach_m)


def frame_axes(axes: Axes, reach_m: float) -> None:
    """Square axes in metres around the vehicle, which drives to the right."""
    axes.set_xlim(-reach_m, reach_m)
    axes.set_ylim(-reach_m, reach_m)
    axes.set_aspect("equal")
    axes.set_xlabel("x forward (m)")
    axes.set_ylabel("y left (m)")
    axes.add_patch(_ego_marker())


def draw_points(axes: Axes, xyz_m: F32) -> None:
    """The sweep in grey, thinned to what a picture can show."""
    step = max(len(xyz_m) // MOST_POINTS, 1)
    x, y = xyz_m[::step, 0], xyz_m[::step, 1]
    size = 1.6 if len(x) < FEW_POINTS else 0.7
    axes.plot(x, y, ".", markersize=size, color=POINT_COLOUR, alpha=0.7, mew=0, zorder=1)


def draw_flow(axes: Axes, snapshot: Snapshot) -> None:
    """Occupied cells in the colour of their velocity; those that were not measured in grey."""
    half = snapshot.grid.cell_m / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    cells = snapshot.xy_m[:, None, :] + corners
    colours = bold_flow_to_rgb(snapshot.velocity_mps, FULL_COLOUR_MPS)
    moving = snapshot.valid & (np.hypot(*snapshot.velocity_mps.T) > STILL_MPS)
    still = PolyCollection(list(cells[~moving]), facecolors="#4b5563", linewidths=0, zorder=2)
    axes.add_collection(still)
    colour = PolyCollection(
        list(cells[moving]), facecolors=list(colours[moving]), linewidths=0, zorder=3
    )
    axes.add_collection(colour)


def draw_boxes(
    axes: Axes,
    boxes: TruthTable | TrackTable,
    ego_T_world: Pose,
    colour: str,
    *,
    linewidth: float,
) -> None:
    """Outlines with a line from the centre to the front."""
    outlines = box_outlines(boxes, ego_T_world)
    axes.add_collection(LineCollection(outlines, colors=colour, linewidths=linewidth, zorder=4))


def box_outlines(boxes: TruthTable | TrackTable, ego_T_world: Pose) -> list[F64]:
    """Per box (7, 2): the closed outline, then front middle and centre."""
    unit = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1], [1, 0], [0, 0]]) / 2
    centres = ego_T_world.apply(boxes.centre_m)[:, :2]
    yaws = boxes.yaw_rad + ego_T_world.yaw_rad
    return [
        (unit * size[:2]) @ rotation_2d(yaw).T + centre
        for size, yaw, centre in zip(boxes.size_m, yaws, centres, strict=True)
    ]


def hulls_of(result: SceneResult, rows: I64) -> list[F64]:
    """The hulls (K, 2) in the world frame of those track rows that have one."""
    ends = np.cumsum(result.tracks.hull_corners)
    starts = ends - result.tracks.hull_corners
    return [result.hull_xy_m[starts[row] : ends[row]] for row in rows if ends[row] > starts[row]]


def draw_hulls(axes: Axes, hulls: Sequence[F64], ego_T_world: Pose) -> None:
    """Outlines of tracks that are polygons instead of boxes."""
    outlines = [ego_T_world.apply(np.pad(hull, ((0, 0), (0, 1))))[:, :2] for hull in hulls]
    closed = [np.concatenate([outline, outline[:1]]) for outline in outlines]
    axes.add_collection(LineCollection(closed, colors=TRACK_COLOUR, linewidths=0.8, zorder=4))


def draw_velocities(axes: Axes, tracks: TrackTable, ego_T_world: Pose) -> None:
    """An arrow as long as the way of one second, and the identity beside it."""
    centres = ego_T_world.apply(tracks.centre_m)[:, :2]
    velocity = tracks.velocity_mps @ rotation_2d(ego_T_world.yaw_rad).T
    if len(tracks):
        arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.003}
        axes.quiver(*centres.T, *velocity.T, color=TRACK_COLOUR, zorder=5, **arrows)
    for centre, identity in zip(centres, tracks.id, strict=True):
        axes.annotate(str(identity), centre, **NUMBER)


def _ego_marker() -> FancyArrow:
    return FancyArrow(
        -1.5, 0, 3, 0, width=0.6, head_width=1.8, length_includes_head=True, color="black", zorder=7
    )

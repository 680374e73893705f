"""Bird's-eye views of a scene's key frames: points, flow, boxes, ids, velocities, ego frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrow
from matplotlib.patheffects import withStroke

from mottrack.core.arrays import F32, F64, I64, U8
from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.motion import FULL_COLOUR_MPS, STILL_MPS
from mottrack.core.pose import Pose, rotation_2d
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.sweep import SECOND_NS, median_period_s
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.viz.colour_wheel import draw_wheel

MOST_POINTS, FEW_POINTS = 40_000, 10_000
"""More than a picture can show; fewer are drawn larger. Chosen by eye."""
TRUTH_COLOUR, TRACK_COLOUR, POINT_COLOUR, STILL_COLOUR = "#2e9e5b", "#c2410c", "#9ca3af", "#4b5563"
SIDE_INCH, DOTS_PER_INCH = 7.6, 100  # Pictures of 760 pixels, which fit on any screen
LEGEND = (("truth", TRUTH_COLOUR, 1.6), ("track, number, velocity", TRACK_COLOUR, 0.8))

# style of a track number: as small as a screen shows it, over whatever is drawn
NUMBER: dict[str, Any] = {
    "fontsize": 7,
    "color": TRACK_COLOUR,
    "clip_on": True,
    "zorder": 6,
    "xytext": (3, 3),
    "textcoords": "offset points",
    "path_effects": [withStroke(linewidth=2, foreground="white")],
}


def draw_key_frames(
    result: SceneResult, snapshots: Sequence[Snapshot], *, reach_m: float = 40.0
) -> Iterator[U8]:
    """Draw a picture (H, W, 3) of each key frame, in order of time.

    Args:
        result: of the scene.
        snapshots: points and flow of its key frames; of a frame without one, boxes alone are drawn.
        reach_m: half the width of the picture.
    """
    figure = Figure(figsize=(SIDE_INCH, SIDE_INCH), dpi=DOTS_PER_INCH, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)  # its methods carry no types
    axes = figure.add_subplot()
    kept = {snapshot.frame: snapshot for snapshot in snapshots}
    start_ns = result.frames.stamp_ns[:1]
    for frame, stamp_ns in enumerate(result.frames.stamp_ns):
        axes.clear()
        bare = Snapshot.of(frame, np.zeros((0, 3), np.float32), None, None)
        draw_bev(axes, result, kept.get(frame, bare), reach_m=reach_m)
        axes.set_title(f"{result.name}   {(stamp_ns - start_ns[0]) / SECOND_NS:.1f} s", fontsize=11)
        for label, colour, linewidth in LEGEND:
            axes.plot([], [], color=colour, linewidth=linewidth, label=label)
        axes.legend(loc="lower left", fontsize=8)
        draw_wheel(axes, (0.87, 0.85), 0.12, f"flow, {FULL_COLOUR_MPS:.0f} m/s")
        canvas.draw()
        yield np.array(canvas.buffer_rgba())[..., :3]


def key_frame_period_s(result: SceneResult) -> float:
    """Return the median time between key frames; a scene of one frame is shown for a second."""
    return median_period_s(result.frames.stamp_ns, default_s=1.0)


def draw_bev(axes: Axes, result: SceneResult, snapshot: Snapshot, *, reach_m: float) -> None:
    """Draw one key frame of a scene.

    Args:
        axes: where to draw.
        result: of the scene; its rows of the snapshot's frame are drawn.
        snapshot: points and flow of that frame.
        reach_m: half the width of the picture.
    """
    ego_T_world = Pose.from_matrix(result.frames.world_T_ego[snapshot.frame]).inverse()
    _draw_points(axes, snapshot.xyz_m)
    _draw_flow(axes, snapshot)
    truth = result.truth.select(result.truth.frame == snapshot.frame)
    _draw_boxes(axes, truth, ego_T_world, TRUTH_COLOUR, linewidth=1.6)
    rows = np.flatnonzero(result.tracks.frame == snapshot.frame)
    tracks = result.tracks.select(rows)
    boxes = tracks.select(tracks.hull_corners == 0)
    _draw_boxes(axes, boxes, ego_T_world, TRACK_COLOUR, linewidth=0.8)
    _draw_hulls(axes, hulls_of(result, rows), ego_T_world)
    _draw_velocities(axes, tracks, ego_T_world)
    _frame_axes(axes, reach_m)


def _frame_axes(axes: Axes, reach_m: float) -> None:
    """Set square axes in metres around the vehicle, which drives to the right."""
    axes.set_xlim(-reach_m, reach_m)
    axes.set_ylim(-reach_m, reach_m)
    axes.set_aspect("equal")
    axes.set_xlabel("x forward (m)")
    axes.set_ylabel("y left (m)")
    marker: dict[str, Any] = {"width": 0.6, "head_width": 1.8, "length_includes_head": True}
    axes.add_patch(FancyArrow(-1.5, 0, 3, 0, **marker, color="black", zorder=7))


def _draw_points(axes: Axes, xyz_m: F32) -> None:
    """Draw the sweep in grey, thinned to what a picture can show."""
    step = max(len(xyz_m) // MOST_POINTS, 1)
    x, y = xyz_m[::step, 0], xyz_m[::step, 1]
    size = 1.6 if len(x) < FEW_POINTS else 0.7
    axes.plot(x, y, ".", markersize=size, color=POINT_COLOUR, alpha=0.7, mew=0, zorder=1)


def _draw_flow(axes: Axes, snapshot: Snapshot) -> None:
    """Draw occupied cells in the colour of their velocity; unmeasured and resting ones in grey."""
    half = snapshot.grid.cell_m / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    cells = snapshot.xy_m[:, None, :] + corners
    colours = bold_flow_to_rgb(snapshot.velocity_mps, FULL_COLOUR_MPS)
    moving = snapshot.valid & (np.hypot(*snapshot.velocity_mps.T) > STILL_MPS)
    still = PolyCollection(list(cells[~moving]), facecolors=STILL_COLOUR, linewidths=0, zorder=2)
    axes.add_collection(still)
    colour = PolyCollection(
        list(cells[moving]), facecolors=list(colours[moving]), linewidths=0, zorder=3
    )
    axes.add_collection(colour)


def _draw_boxes(
    axes: Axes,
    boxes: TruthTable | TrackTable,
    ego_T_world: Pose,
    colour: str,
    *,
    linewidth: float,
) -> None:
    """Draw outlines with a line from the centre to the front."""
    # the closed outline, then front middle and centre
    unit = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1], [1, 0], [0, 0]]) / 2
    centres = ego_T_world.apply(boxes.centre_m)[:, :2]
    yaws = boxes.yaw_rad + ego_T_world.yaw_rad
    outlines = [
        (unit * size[:2]) @ rotation_2d(yaw).T + centre
        for size, yaw, centre in zip(boxes.size_m, yaws, centres, strict=True)
    ]
    axes.add_collection(LineCollection(outlines, colors=colour, linewidths=linewidth, zorder=4))


def hulls_of(result: SceneResult, rows: I64) -> list[F64]:
    """Return the hulls (K, 2) in the world frame of those track rows that have one."""
    ends = np.cumsum(result.tracks.hull_corners)
    starts = ends - result.tracks.hull_corners
    return [result.hull_xy_m[starts[row] : ends[row]] for row in rows if ends[row] > starts[row]]


def _draw_hulls(axes: Axes, hulls: Sequence[F64], ego_T_world: Pose) -> None:
    """Draw outlines of tracks that are polygons instead of boxes."""
    outlines = [ego_T_world.apply(np.pad(hull, ((0, 0), (0, 1))))[:, :2] for hull in hulls]
    closed = [np.concatenate([outline, outline[:1]]) for outline in outlines]
    axes.add_collection(LineCollection(closed, colors=TRACK_COLOUR, linewidths=0.8, zorder=4))


def _draw_velocities(axes: Axes, tracks: TrackTable, ego_T_world: Pose) -> None:
    """Draw the displacement of one second as an arrow, and the identity beside it."""
    centres = ego_T_world.apply(tracks.centre_m)[:, :2]
    velocity = tracks.velocity_mps @ rotation_2d(ego_T_world.yaw_rad).T
    reported = np.isfinite(velocity).all(axis=1)  # a tracker of others may report none
    if reported.any():
        arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.003}
        axes.quiver(
            *centres[reported].T, *velocity[reported].T, color=TRACK_COLOUR, zorder=5, **arrows
        )
    for centre, identity in zip(centres, tracks.id, strict=True):
        axes.annotate(str(identity), centre, **NUMBER)

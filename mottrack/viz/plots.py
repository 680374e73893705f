"""Plots for programs and notebooks: each draws into matplotlib axes and returns them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.motion import FULL_COLOUR_MPS, RESTING, STILL_MPS, FlowField
from mottrack.core.objects import Boxes, Tracks
from mottrack.core.pictures import TRACK, footprints
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.viz.bev import draw_bev
from mottrack.viz.colour_wheel import draw_wheel


def plot_boxes(boxes: Boxes, axes: Axes | None = None, colour: str = TRACK) -> Axes:
    """Draw boxes seen from above; of tracks also the displacement in one second.

    Args:
        boxes: `Objects`, `Tracks` or `Truth`, in the world or the ego frame.
        axes: where to draw; None: new ones.
        colour: of the outlines.
    """
    axes = _axes(axes)
    outlines = [np.vstack([o, o[:1]]) for o in _outlines(boxes)]
    axes.add_collection(LineCollection(outlines, colors=colour, linewidths=1.2))
    if isinstance(boxes, Tracks) and len(boxes):
        arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.003}
        axes.quiver(*boxes.centre_m[:, :2].T, *boxes.velocity_mps.T, color=colour, **arrows)
    axes.autoscale_view()
    return _in_metres(axes, boxes.frame)


def plot_flow(field: FlowField, axes: Axes | None = None) -> Axes:
    """Draw a flow field: hue is direction, cells at rest or not measured are grey.

    Args:
        field: in the axes of the current ego frame.
        axes: where to draw; None: new ones.
    """
    axes = _axes(axes)
    grid = field.grid
    rgb = np.ones((*grid.shape, 3))
    rgb[field.occupied] = np.array(RESTING) / 255
    speed_mps = np.hypot(field.velocity_mps[..., 0], field.velocity_mps[..., 1])
    moving = field.valid & (speed_mps > STILL_MPS)
    rgb[moving] = bold_flow_to_rgb(field.velocity_mps[moving], FULL_COLOUR_MPS)
    extent = (grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m)
    axes.imshow(rgb, origin="lower", extent=extent, interpolation="nearest")
    draw_wheel(axes, (0.84, 0.82), 0.15, f"{FULL_COLOUR_MPS:.0f} m/s")
    return _in_metres(axes, "ego")


def plot_scene(
    result: SceneResult,
    frame: int = -1,
    axes: Axes | None = None,
    *,
    snapshots: Sequence[Snapshot] = (),
    reach_m: float = 40.0,
) -> Axes:
    """Draw a key frame of a stored scene in the vehicle's frame: truth green, tracks orange.

    Args:
        result: of the scene.
        frame: its key frame; negative ones count from the end.
        axes: where to draw; None: new ones.
        snapshots: points and flow of its key frames, if they were stored.
        reach_m: half the width shown.
    """
    axes = _axes(axes)
    number = range(len(result.frames))[frame]
    bare = Snapshot.of(number, np.zeros((0, 3), np.float32), None, None)
    kept = next((s for s in snapshots if s.frame == number), bare)
    draw_bev(axes, result, kept, reach_m=reach_m)
    axes.set_title(f"{result.name}, frame {number}")
    return axes


def _outlines(boxes: Boxes) -> Sequence[np.ndarray]:
    return footprints(boxes.centre_m, boxes.size_m, boxes.yaw_rad)


def _axes(axes: Axes | None) -> Axes:
    return pyplot.subplots(figsize=(5, 5))[1] if axes is None else axes


def _in_metres(axes: Axes, frame: str) -> Axes:
    axes.set_aspect("equal")
    axes.set_xlabel(f"x (m, {frame})")
    axes.set_ylabel(f"y (m, {frame})")
    return axes

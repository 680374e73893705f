"""Flow of several sources side by side, a line for each scene (the paper, Figure 3).

Hue is the direction of the velocity over the ground and paleness its slowness, in the Middlebury
colours; the wheel in the first picture is the key. Grey cells stand still, light grey ones were
not measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.snapshot import Snapshot
from mottrack.viz.colour_wheel import bold_flow_to_rgb, wheel_picture

Picture = tuple[str, FlowField | Snapshot]
"""A title and what to draw under it."""
MOVING_MPS = 0.5
STILL, UNMEASURED = 0.62, 0.85
WHEEL_PIXELS = 121


def flow_comparison(
    lines: Sequence[Sequence[Picture]], *, max_mps: float = 15.0, reach_m: float = 40.0
) -> Figure:
    """A figure with one line of pictures for each scene; titles stand over the first line.

    Args:
        lines: for each scene its pictures from left to right, in the same ego frame.
        max_mps: speed of the full colour.
        reach_m: half the width that each picture shows, around the vehicle.

    Raises:
        InputError: there is no picture, or the lines are of different lengths.
    """
    lengths = {len(line) for line in lines}
    if len(lengths) != 1 or not max(lengths):
        raise InputError("pictures in each line", sorted(lengths), "the same number, at least one")
    columns = max(lengths)
    figure = Figure(figsize=(3.3 * columns, 3.3 * len(lines) + 0.25), layout="constrained")
    axes = figure.subplots(len(lines), columns, squeeze=False)
    for row, line in zip(axes, lines, strict=True):
        for axis, (_, flow) in zip(row, line, strict=True):
            _draw(axis, flow, max_mps, reach_m)
    for axis, (title, _) in zip(axes[0], lines[0], strict=True):
        axis.set_title(title, fontsize=10)
    _draw_wheel(axes[0, 0], max_mps)
    return figure


def flow_image(flow: FlowField | Snapshot, max_mps: float) -> F64:
    """Colours (H, W, 3) in [0, 1], white where nothing is.

    Moving cells are drawn three cells wide: a cell of a quarter metre is less than a pixel.
    """
    grid, cells, velocity_mps, valid = _cells(flow)
    image = np.ones((*grid.shape, 3))
    image[cells[~valid, 0], cells[~valid, 1]] = UNMEASURED
    speed_mps = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    moving = valid & (speed_mps > MOVING_MPS)
    still = valid & ~moving
    image[cells[still, 0], cells[still, 1]] = STILL
    colours = bold_flow_to_rgb(velocity_mps[moving], max_mps)
    taken = np.zeros(grid.shape, np.bool_)
    taken[cells[:, 0], cells[:, 1]] = True
    for down, right in np.ndindex(3, 3):
        rows, cols = cells[moving, 0] + down - 1, cells[moving, 1] + right - 1
        usable = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
        usable[usable] = ~taken[rows[usable], cols[usable]]
        image[rows[usable], cols[usable]] = colours[usable]
    image[cells[moving, 0], cells[moving, 1]] = colours
    return image


def _cells(
    flow: FlowField | Snapshot,
) -> tuple[BevGrid, I64, F32, Mask]:
    if isinstance(flow, Snapshot):
        return flow.grid, flow.cells, flow.velocity_mps, flow.valid
    occupied = flow.occupied
    return flow.grid, np.argwhere(occupied), flow.velocity_mps[occupied], flow.valid[occupied]


def _draw(axes: Axes, flow: FlowField | Snapshot, max_mps: float, reach_m: float) -> None:
    grid = flow.grid
    extent = (grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m)
    image = flow_image(flow, max_mps)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest")
    axes.plot(0, 0, marker=(3, 0, -90), color="black", markersize=6)
    axes.set_xlim(-reach_m, reach_m)
    axes.set_ylim(-reach_m, reach_m)
    axes.set_xticks([])
    axes.set_yticks([])


def _draw_wheel(axes: Axes, max_mps: float) -> None:
    """The key in the corner: the colour of each velocity up to the full one."""
    key = axes.inset_axes((0.01, 0.01, 0.17, 0.17))
    key.imshow(wheel_picture(WHEEL_PIXELS))
    key.set_title(f"{max_mps:g} m/s", fontsize=7, pad=2)
    key.set_axis_off()

"""Flow of several sources side by side, a row for each scene (the paper, Figure 3).

Hue is the direction of the velocity over the ground and paleness its slowness, in the Middlebury
colours; the wheel in the first picture is the key. Grey cells stand still, light grey ones were
not measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mottrack.core.arrays import F64
from mottrack.core.errors import InputError
from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.core.snapshot import Snapshot
from mottrack.viz.colour_wheel import draw_wheel

STILL, UNMEASURED = 0.62, 0.85  # Grey levels in [0, 1]


class FlowPanel(NamedTuple):
    """One picture of the figure."""

    title: str
    flow: FlowField | Snapshot


def flow_comparison(
    rows: Sequence[Sequence[FlowPanel]], *, max_mps: float = 15.0, reach_m: float = 40.0
) -> Figure:
    """Draw a figure with one row of panels for each scene; titles are above the first row.

    Args:
        rows: for each scene its panels from left to right, in the same ego frame.
        max_mps: speed of the full colour.
        reach_m: half the width that each picture shows, around the vehicle.

    Raises:
        InputError: there is no panel, or the rows are of different lengths.
    """
    lengths = {len(row) for row in rows}
    if len(lengths) != 1 or not max(lengths):
        raise InputError("panels in each row", sorted(lengths), "the same number, at least one")
    columns = max(lengths)
    figure = Figure(figsize=(3.3 * columns, 3.3 * len(rows) + 0.25), layout="constrained")
    axes = figure.subplots(len(rows), columns, squeeze=False)
    for row_axes, row in zip(axes, rows, strict=True):
        for axis, panel in zip(row_axes, row, strict=True):
            _draw(axis, panel.flow, max_mps, reach_m)
    for axis, panel in zip(axes[0], rows[0], strict=True):
        axis.set_title(panel.title, fontsize=10)
    draw_wheel(axes[0, 0], (0.01, 0.01), 0.17, f"{max_mps:g} m/s")
    return figure


def flow_image(flow: FlowField | Snapshot, max_mps: float) -> F64:
    """Return colours (H, W, 3) in [0, 1], white where nothing is.

    Moving cells are drawn three cells wide: a cell of a quarter metre is less than a pixel.
    """
    grid = flow.grid
    if isinstance(flow, Snapshot):
        cells, velocity_mps, valid = flow.cells, flow.velocity_mps, flow.valid
    else:
        cells, kept = np.argwhere(flow.occupied), flow.occupied
        velocity_mps, valid = flow.velocity_mps[kept], flow.valid[kept]
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

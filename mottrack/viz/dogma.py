"""The dynamic occupancy grid map in colour: free, occupied and moving cells, still or as a GIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image

from mottrack.core.checks import as_array
from mottrack.core.errors import InputError
from mottrack.core.pose import Pose
from mottrack.viz.colour_wheel import flow_to_rgb

FULL_COLOUR_MPS = 15.0
FREE, UNKNOWN, OCCUPIED = 255.0, 160.0, 0.0
"""Grey levels: what is free is white, what is unknown grey, what is occupied black."""


@dataclass(frozen=True, slots=True)
class MapPicture:
    """What is drawn of one map; (rows, cols) along world y and x.

    Raises:
        InputError: a shape is not that of `occupied`.
    """

    occupied: NDArray[np.float32]
    """(rows, cols) mass of occupied."""
    free: NDArray[np.float32]
    """(rows, cols) mass of free."""
    moving: NDArray[np.bool_]
    """(rows, cols) cells that are shown in the colour of their velocity."""
    velocity_mps: NDArray[np.float32]
    """(rows, cols, 2) velocity in world axes."""
    corner_m: tuple[float, float]
    """World x and y of the lower corner."""
    cell_m: float
    world_T_ego: Pose | None = None
    """Where the vehicle stands; None: not drawn."""

    def __post_init__(self) -> None:
        shape = np.shape(self.occupied)
        if len(shape) != 2:
            raise InputError("shape of occupied", shape, "(rows, cols)")
        as_array("free", self.free, np.float32, shape)
        as_array("moving", self.moving, np.bool_, shape)
        as_array("velocity_mps", self.velocity_mps, np.float32, (*shape, 2))


def map_to_rgb(picture: MapPicture) -> NDArray[np.uint8]:
    """(rows, cols, 3) colours; row 0 is the lowest y.

    The grey level goes from unknown towards white by the free mass and towards black by the
    occupied mass; a moving cell has the hue of its direction and the strength of its speed.
    """
    grey = UNKNOWN + picture.free * (FREE - UNKNOWN) + picture.occupied * (OCCUPIED - UNKNOWN)
    rgb = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=-1)
    colours = flow_to_rgb(picture.velocity_mps[picture.moving], FULL_COLOUR_MPS)
    rgb[picture.moving] = np.round(255 * colours).astype(np.uint8)
    return rgb


def draw_map(axes: Axes, picture: MapPicture, arrows_every: int = 6) -> None:
    """Draws the map in world axes, an arrow of one second at some of the moving cells."""
    rows, cols = picture.occupied.shape
    x_m, y_m = picture.corner_m
    extent = (x_m, x_m + cols * picture.cell_m, y_m, y_m + rows * picture.cell_m)
    axes.imshow(map_to_rgb(picture), origin="lower", extent=extent, interpolation="nearest")
    row, col = (index[::arrows_every] for index in np.nonzero(picture.moving))
    vx, vy = picture.velocity_mps[row, col].T
    place_x, place_y = x_m + (col + 0.5) * picture.cell_m, y_m + (row + 0.5) * picture.cell_m
    axes.quiver(place_x, place_y, vx, vy, angles="xy", scale_units="xy", scale=1, width=0.002)
    if picture.world_T_ego is not None:
        here_m = picture.world_T_ego.apply(np.array([[0.0, 0.0, 0.0], [2.5, 0.0, 0.0]]))
        axes.plot(*here_m[:, :2].T, color="#c2410c", linewidth=3, solid_capstyle="round")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def save_gif(pictures: Sequence[MapPicture], path: Path, period_s: float = 0.1) -> None:
    """Writes the maps of a scene as an animation, north up, two pixels a cell.

    Raises:
        InputError: there is no picture, or their sizes differ.
    """
    shapes = {picture.occupied.shape for picture in pictures}
    if len(shapes) != 1:
        raise InputError("sizes of pictures", sorted(shapes), "one size, of at least one picture")
    frames = [Image.fromarray(map_to_rgb(picture)[::-1]).quantize(128) for picture in pictures]
    frames = [frame.resize((2 * frame.width, 2 * frame.height)) for frame in frames]
    duration_ms = round(1000 * period_s)
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=duration_ms, loop=0, optimize=False
    )

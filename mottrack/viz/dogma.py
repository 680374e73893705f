"""The dynamic occupancy grid map in colour, as the literature draws it.

White is free, grey unknown, black occupied; occupied cells that move have the hue of their
direction. The vehicle is outlined in orange; a wheel of directions and a scale are in corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from mottrack.core.arrays import F32, U8, Mask
from mottrack.core.checks import as_array
from mottrack.core.errors import InputError
from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.pose import Pose
from mottrack.viz.colour_wheel import wheel_picture

FULL_COLOUR_MPS = 8.0  # Slower than in a flow picture: the map shows that cells move, and where to
FREE, UNKNOWN, OCCUPIED = 255.0, 160.0, 0.0  # Grey levels
EGO_COLOUR, INK = (234, 88, 12), (30, 30, 30)
EGO_OUTLINE_M = np.array([[3.8, 0.0], [2.6, 0.95], [-1.0, 0.95], [-1.0, -0.95], [2.6, -0.95]])
"""A car of 4.8 m by 1.9 m around its rear axle, pointed at the front."""
SCALE_M = 10.0
FONT_PIXELS = 16
MARGIN = 14  # Pixels between a corner and what is drawn in it


@dataclass(frozen=True, slots=True)
class MapPicture:
    """What is drawn of one map; (rows, cols) along world y and x.

    Raises:
        InputError: a shape is not that of `occupied`.
    """

    occupied: F32
    """(rows, cols) mass of occupied."""
    free: F32
    """(rows, cols) mass of free."""
    moving: Mask
    """(rows, cols) cells that are shown in the colour of their velocity."""
    velocity_mps: F32
    """(rows, cols, 2) velocity in world axes."""
    corner_m: tuple[float, float]
    """World x and y of the lower corner."""
    cell_m: float
    world_T_ego: Pose | None = None
    """Pose of the vehicle; None: not drawn."""
    title: str = ""
    """Text in the upper left corner."""

    def __post_init__(self) -> None:
        shape = np.shape(self.occupied)
        if len(shape) != 2:
            raise InputError("shape of occupied", shape, "(rows, cols)")
        as_array("free", self.free, np.float32, shape)
        as_array("moving", self.moving, np.bool_, shape)
        as_array("velocity_mps", self.velocity_mps, np.float32, (*shape, 2))


def map_to_rgb(picture: MapPicture) -> U8:
    """Return (rows, cols, 3) colours; row 0 is the lowest y.

    The grey level goes from unknown towards white by the free mass and towards black by the
    occupied mass; a moving cell has the hue of its direction, never paler than can be seen.
    """
    grey = UNKNOWN + picture.free * (FREE - UNKNOWN) + picture.occupied * (OCCUPIED - UNKNOWN)
    rgb = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=-1)
    colours = bold_flow_to_rgb(picture.velocity_mps[picture.moving], FULL_COLOUR_MPS)
    rgb[picture.moving] = np.round(255 * colours).astype(np.uint8)
    return rgb


def draw_map(picture: MapPicture, scale: int = 2) -> U8:
    """Draw a (rows * scale, cols * scale, 3) picture, north up, with vehicle, wheel and scale."""
    rgb = map_to_rgb(picture)[::-1].repeat(scale, axis=0).repeat(scale, axis=1)
    image = Image.fromarray(rgb)
    pen = ImageDraw.Draw(image)
    _draw_vehicle(pen, picture, scale)
    _draw_scale(pen, image.size, SCALE_M / picture.cell_m * scale)
    pen.text((MARGIN, MARGIN), picture.title, fill=INK, font_size=FONT_PIXELS)
    wheel = Image.fromarray(wheel_picture(max(min(image.size) // 7, 16)))
    image.paste(wheel, (image.width - wheel.width - MARGIN, MARGIN), wheel)
    return np.asarray(image)


def _draw_vehicle(pen: ImageDraw.ImageDraw, picture: MapPicture, scale: int) -> None:
    if picture.world_T_ego is None:
        return
    outline = np.pad(EGO_OUTLINE_M, ((0, 0), (0, 1)))
    cells = (picture.world_T_ego.apply(outline)[:, :2] - picture.corner_m) / picture.cell_m
    rows = picture.occupied.shape[0]
    corners = [(x * scale, (rows - y) * scale) for x, y in cells.tolist()]
    pen.polygon(corners, outline=EGO_COLOUR, width=max(scale, 2))


def _draw_scale(pen: ImageDraw.ImageDraw, size: tuple[int, int], length: float) -> None:
    x, y = MARGIN, size[1] - MARGIN
    pen.line([(x, y), (x + length, y)], fill=INK, width=3)
    pen.text((x, y - 22), f"{SCALE_M:.0f} m", fill=INK, font_size=FONT_PIXELS)

"""The key to the colours of flow, drawn into a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mottrack.core.arrays import U8
from mottrack.core.flow_colour import flow_to_rgb

WHEEL_PIXELS = 121  # more than it has on any picture


def wheel_picture(pixels: int) -> U8:
    """Return (pixels, pixels, 4) the key to the colours: RGBA, y up, transparent around it."""
    ticks = np.linspace(-1, 1, pixels)
    x, y = np.meshgrid(ticks, ticks[::-1])
    rgb = np.round(255 * flow_to_rgb(np.stack([x, y], axis=-1), 1.0)).astype(np.uint8)
    alpha = np.where(np.hypot(x, y) <= 1, 255, 0).astype(np.uint8)
    return np.dstack([rgb, alpha])


def draw_wheel(axes: Axes, corner: tuple[float, float], side: float, title: str) -> None:
    """Draw the key to the colours into axes; corner and side in shares of theirs."""
    key = axes.inset_axes((*corner, side, side))
    key.imshow(wheel_picture(WHEEL_PIXELS))
    key.set_title(title, fontsize=7, pad=2)
    key.set_axis_off()

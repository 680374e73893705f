"""A scene as a film: every key frame from above, in the frame of the vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mottrack.core.arrays import U8
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.viz.bev import FULL_COLOUR_MPS, TRACK_COLOUR, TRUTH_COLOUR, draw_bev
from mottrack.viz.colour_wheel import wheel_picture

SIDE_INCH, DOTS_PER_INCH = 7.6, 100
LEGEND = (("truth", TRUTH_COLOUR, 1.6), ("track, number, velocity", TRACK_COLOUR, 0.8))


def film(
    result: SceneResult, snapshots: Sequence[Snapshot], *, reach_m: float = 40.0
) -> Iterator[U8]:
    """A picture (H, W, 3) of each key frame, in order of time.

    Args:
        result: of the scene.
        snapshots: points and flow of its key frames; of a frame without one, boxes are drawn alone.
        reach_m: half the width of the picture.
    """
    figure = Figure(figsize=(SIDE_INCH, SIDE_INCH), dpi=DOTS_PER_INCH, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)  # its methods carry no types
    axes = figure.add_subplot()
    kept = {snapshot.frame: snapshot for snapshot in snapshots}
    start_ns = result.frames.stamp_ns[:1]
    for frame, stamp_ns in enumerate(result.frames.stamp_ns):
        axes.clear()
        draw_bev(axes, result, kept.get(frame, bare(frame)), reach_m=reach_m)
        axes.set_title(f"{result.name}   {(stamp_ns - start_ns[0]) / 1e9:.1f} s", fontsize=11)
        _draw_key(axes)
        canvas.draw()
        yield np.array(canvas.buffer_rgba())[..., :3]


def period_s(result: SceneResult) -> float:
    """The median time between key frames; a scene of one frame is shown for a second."""
    stamps_ns = result.frames.stamp_ns
    return float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else 1.0


def bare(frame: int) -> Snapshot:
    """Neither points nor flow, where a run kept none."""
    return Snapshot.of(frame, np.zeros((0, 3), np.float32), None, None)


def _draw_key(axes: Axes) -> None:
    for label, colour, linewidth in LEGEND:
        axes.plot([], [], color=colour, linewidth=linewidth, label=label)
    axes.legend(loc="lower left", fontsize=8)
    key = axes.inset_axes((0.87, 0.85, 0.12, 0.12))
    key.imshow(wheel_picture(121))
    key.set_title(f"flow, {FULL_COLOUR_MPS:.0f} m/s", fontsize=7, pad=2)
    key.set_axis_off()

"""Pictures of a comparison, as PNG in a data URL."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mottrack.core.snapshot import Snapshot, load_snapshots
from mottrack.pipeline.comparison import ScoredRun, velocity_rows
from mottrack.pipeline.terminal import title
from mottrack.viz.bev import FULL_COLOUR_MPS, TRACK_COLOUR, TRUTH_COLOUR, draw_bev
from mottrack.viz.colour_wheel import flow_to_rgb

REACH_M = 40.0
COLUMNS = 3


def bev_grid(runs: Sequence[ScoredRun], scene: str) -> str | None:
    """The same frame of a scene under every run, side by side; None where nothing was kept."""
    shots = [(run, shot) for run in runs if (shot := _snapshot(run, scene)) is not None]
    if not shots:
        return None
    columns = min(COLUMNS, len(shots))
    rows = -(-len(shots) // columns)
    figure = Figure(figsize=(5.4 * columns, 5.7 * rows), layout="constrained")
    for index, (run, shot) in enumerate(shots):
        axes = figure.add_subplot(rows, columns, index + 1)
        draw_bev(axes, run.folder.load(scene), shot, reach_m=REACH_M)
        axes.set_title(title(run), fontsize=11)
        if index == 0:
            draw_wheel(axes.inset_axes((0.8, 0.8, 0.19, 0.19)))
            _legend(axes)
    return data_url(figure)


def velocity_bars(runs: Sequence[ScoredRun]) -> str:
    """Mean velocity error of every category, a bar a run."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.add_subplot()
    rows = [r for r in velocity_rows(runs) if any(run.velocity_error(r).count for run in runs)]
    width = 0.8 / len(runs)
    for index, run in enumerate(runs):
        heights = [run.velocity_error(row).mean_mps for row in rows]
        axes.bar(np.arange(len(rows)) + index * width, heights, width, label=title(run))
    axes.set_xticks(np.arange(len(rows)) + 0.4 - width / 2, [_wrapped(r) for r in rows])
    axes.tick_params(axis="x", labelsize=7)
    axes.set_ylabel("mean velocity error (m/s)")
    axes.legend(fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    return data_url(figure)


def draw_wheel(axes: Axes) -> None:
    """The colour code of flow: direction is hue, full colour at 15 m/s."""
    ticks = np.linspace(-1, 1, 121)
    x, y = np.meshgrid(ticks, ticks)
    rgb = flow_to_rgb(np.stack([x, y], axis=-1) * FULL_COLOUR_MPS, FULL_COLOUR_MPS)
    alpha = (np.hypot(x, y) <= 1).astype(float)
    axes.imshow(np.dstack([rgb, alpha]), origin="lower", extent=(-1, 1, -1, 1))
    axes.set_title(f"{FULL_COLOUR_MPS:.0f} m/s", fontsize=7, pad=2)
    axes.set_axis_off()


def data_url(figure: Figure) -> str:
    """The figure as a PNG inside a URL."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _snapshot(run: ScoredRun, scene: str) -> Snapshot | None:
    path = run.folder.snapshots_file(scene)
    if scene not in run.report.finished or not path.exists():
        return None
    shots = load_snapshots(path)
    return shots[len(shots) // 2]


def _legend(axes: Axes) -> None:
    for label, colour in (("truth", TRUTH_COLOUR), ("track, id, velocity", TRACK_COLOUR)):
        axes.plot([], [], color=colour, label=label)
    axes.legend(loc="lower left", fontsize=7)


def _wrapped(text: str) -> str:
    return text.replace(" ", "\n", 2)


matplotlib.rcParams["font.size"] = 9

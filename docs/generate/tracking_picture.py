"""The picture of the README: the same tracker on the same sweeps, without and with flow.

mottrack demo
python docs/generate/tracking_picture.py out/demo docs/tracking.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot

from mottrack.core.motion import FULL_COLOUR_MPS
from mottrack.runs.run_folder import StoredScene
from mottrack.viz.bev import LEGEND, draw_bev
from mottrack.viz.colour_wheel import draw_wheel

SCENE, FRAME, REACH_M = "synthetic-s1000-0002", 12, 30.0
"""A junction with traffic in all directions, after the tracks have settled."""
PANELS = {"zero": "without flow", "pillarflow": "with PillarFlow"}


def main(folder: Path, out: Path) -> None:
    figure, axes = pyplot.subplots(1, 2, figsize=(13, 6.6), layout="constrained")
    for panel, (run, title) in zip(axes, PANELS.items(), strict=True):
        stored = StoredScene.load(folder / run, SCENE)
        snapshot = next(s for s in stored.snapshots if s.frame == FRAME)
        draw_bev(panel, stored.result, snapshot, reach_m=REACH_M)
        panel.set_title(f"fixed-lag tracker on clusters, {title}")
        for label, colour, width in LEGEND:
            panel.plot([], [], color=colour, linewidth=width, label=label)
    axes[0].legend(loc="lower left", fontsize=8)
    draw_wheel(axes[1], (0.86, 0.84), 0.13, f"flow, {FULL_COLOUR_MPS:.0f} m/s")
    figure.savefig(out, dpi=90)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

"""Truth, ICP, binary OGM and PillarFlow side by side in Middlebury colours (the paper, Fig. 4).

    python benchmarks/flow_picture.py [--out flow.png] [--pairs 3] [--refined 1] [--quick]

Each line is a held-out scene of the embedded world. Colour is direction, strength is speed, up to
`MAX_MPS`; grey cells are occupied and at rest, or were not measured.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from _common import arguments
from _world_cells import HeldOut, held_out_pairs
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.flow.icp import IcpConfig, IcpFlow
from mottrack.flow.pillarflow.source import (
    BinaryOgmConfig,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.viz.colour_wheel import flow_to_rgb

MAX_MPS = 15.0
REST = 0.8
TITLES = ("truth", "ICP + Det.", "binary OGM", "PillarFlow")


def estimate(source: FlowSource, pair: HeldOut) -> NDArray[np.float32]:
    source.reset()
    for frame in pair.frames:
        if isinstance(source, FrameObserver):
            source.observe(frame)
    field = source.estimate(pair.previous, pair.current)
    return np.where(field.valid[..., None], field.velocity_mps, np.float32(0))


def coloured(velocity_mps: NDArray[np.float32], occupied: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(H,W,3) colours: white where empty, grey at rest, the flow's colour where something moves."""
    image = np.ones((*occupied.shape, 3))
    image[occupied] = REST
    moving = occupied & (np.linalg.norm(velocity_mps, axis=-1) > 0.5)
    image[moving] = flow_to_rgb(velocity_mps[moving], MAX_MPS)
    return image


def main() -> None:
    given = arguments(__doc__ or "", out=Path, pairs=int, refined=int)
    refined = bool(given.refined)
    sources: tuple[FlowSource, ...] = (
        IcpFlow(IcpConfig(starts=1)),
        BinaryOgmFlow(BinaryOgmConfig(refined=refined)),
        PillarFlow(PillarFlowConfig(refined=refined)),
    )
    grid = BevGrid()
    count = given.pairs or (1 if given.quick else 3)
    figure = Figure(figsize=(13, 3.4 * count), layout="constrained")
    axes = figure.subplots(count, len(TITLES), squeeze=False)
    for line, pair in zip(axes, held_out_pairs(count, grid), strict=True):
        fields = [pair.velocity_mps, *(estimate(source, pair) for source in sources)]
        for axis, title, velocity in zip(line, TITLES, fields, strict=True):
            extent = (grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m)
            axis.imshow(coloured(velocity, pair.occupied), origin="lower", extent=extent)
            axis.set_title(title, fontsize=9)
            axis.set_xticks([])
            axis.set_yticks([])
    figure.savefig(given.out or Path("flow.png"), dpi=150)


if __name__ == "__main__":
    main()

"""Truth, ICP, binary OGM and PillarFlow side by side in Middlebury colours (the paper, Figure 3).

    python benchmarks/flow_picture.py [--out flow.png] [--scenes 0,7] [--refined 1] [--quick]

Each line is one of the held-out scenes of `flow_tables.py`, by its number. Colour is direction,
strength is speed; grey cells are at rest, light ones were not measured.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from _common import arguments
from _world_cells import HeldOut, held_out_pairs

from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import FlowField
from mottrack.flow.icp import IcpConfig, IcpFlow
from mottrack.flow.pillarflow.source import (
    BinaryOgmConfig,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.viz.flow_comparison import FlowPanel, flow_comparison


def true_field(pair: HeldOut, grid: BevGrid) -> FlowField:
    nothing = FlowField.unmeasured(grid, pair.occupied, pair.current.stamp_ns)
    return FlowField(
        grid=grid,
        velocity_mps=np.where(pair.occupied[..., None], pair.velocity_mps, np.float32(0)),
        covariance_m2ps2=nothing.covariance_m2ps2,
        occupied=pair.occupied,
        valid=pair.occupied,
        weight=nothing.weight,
        stamp_ns=pair.current.stamp_ns,
    )


def estimate(source: FlowSource, pair: HeldOut) -> FlowField:
    source.reset()
    for frame in pair.frames:
        if isinstance(source, FrameObserver):
            source.observe(frame)
    return source.estimate(pair.previous, pair.current)


def main() -> None:
    given = arguments(__doc__ or "", out=Path, scenes=str, refined=int)
    refined = bool(given.refined)
    grid = BevGrid()
    sources: dict[str, FlowSource] = {
        "ICP + Det.": IcpFlow(IcpConfig(starts=1)),
        "binary OGM": BinaryOgmFlow(BinaryOgmConfig(refined=refined)),
        "PillarFlow": PillarFlow(PillarFlowConfig(refined=refined)),
    }
    wanted = [
        int(number) for number in (given.scenes or ("0" if given.quick else "0,7")).split(",")
    ]
    lines: list[list[FlowPanel]] = []
    for number, pair in enumerate(held_out_pairs(max(wanted) + 1, grid)):
        if number in wanted:
            line = [FlowPanel("truth", true_field(pair, grid))]
            lines.append(
                [*line, *(FlowPanel(name, estimate(one, pair)) for name, one in sources.items())]
            )
    flow_comparison(lines).savefig(given.out or Path("flow.png"), dpi=150)


if __name__ == "__main__":
    main()

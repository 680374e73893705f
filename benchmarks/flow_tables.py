"""The paper's Tables I and II on held-out scenes of the embedded world.

    python benchmarks/flow_tables.py [--pairs 60] [--rows icp,binary_ogm,pillarflow] \
        [--ablation FOLDER] [--json FILE] [--quick]

Every row is scored on the same cells: the occupied 0.25 m cells of one pair from each of `--pairs`
scenes that no training used, each with a sensor and a place of its own. RMSE is of the velocity in
m/s and of the flow in metres (the paper's unit); a cell that a source did not measure counts as
zero. Dynamic cells move faster than 0.5 m/s; `seen` are dynamic cells whose object was hit at
least five times in both sweeps (others cannot be matched by anyone).

Table II's rows are the shipped weights `pwc`, `spynet`, `flownet` and `with_ground`, trained alike;
`--ablation` names a folder with runs of your own in their place (`mottrack train train_spynet --out
FOLDER/spynet`, and so on).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from _common import arguments, report
from _world_cells import HeldOut, held_out_pairs

from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.tables import FlowSamples
from mottrack.eval.flow_error import flow_error
from mottrack.flow.icp import IcpConfig, IcpFlow
from mottrack.flow.pillarflow.source import (
    BinaryOgmConfig,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.flow.stages import StagesConfig
from mottrack.flow.sweep_pair.obstacle_points import GroundStage
from mottrack.flow.zero import ZeroFlow

Sources = dict[str, Callable[[], FlowSource]]


def sources(ablation: Path | None) -> Sources:
    """Name of a row -> how to make its source."""
    table: Sources = {
        "zero": ZeroFlow,
        "icp": lambda: IcpFlow(IcpConfig(starts=1)),
        "icp_many_starts": IcpFlow,
        "binary_ogm": lambda: BinaryOgmFlow(BinaryOgmConfig(refined=False)),
        "pillarflow": lambda: PillarFlow(PillarFlowConfig(refined=False)),
        "pillarflow_small": lambda: PillarFlow(PillarFlowConfig(weights="small", refined=False)),
        "binary_ogm+refined": BinaryOgmFlow,
        "pillarflow+refined": PillarFlow,
    }
    for name in ("pwc", "spynet", "flownet", "with_ground"):
        file = (ablation or Path()) / name / "weights.safetensors"
        weights = str(file) if ablation is not None and file.exists() else name
        table[name] = _ablation(weights, ground=name != "with_ground")
    return table


def _ablation(weights: str, *, ground: bool) -> Callable[[], FlowSource]:
    stages = StagesConfig(ground=GroundStage(enabled=ground))
    config = PillarFlowConfig(weights=weights, refined=False, stages=stages)
    return lambda: PillarFlow(config)


PAPER = (
    ("ICP + Det.", 2.818, None, 2.818, 0.216),
    ("binary OGM", 1.316, 0.113, 0.247, 0.091),
    ("PillarFlow", 1.127, 0.110, 0.207, 0.108),
    ("II: SpyNet", None, None, 0.327, 0.122),
    ("II: FlowNet2", None, None, 0.320, 0.072),
    ("II: PWC, w/o ground", None, None, 0.207, 0.087),
    ("II: with ground", None, None, 0.246, 0.079),
)
"""The printed Tables I and II, nuScenes: RMSE in metres of dynamic, static and all cells; AAE."""


def printed() -> list[dict[str, object]]:
    """The paper's rows; its flow is of key frames or sweeps of nuScenes, ours of 0.1 s."""
    keys = ("the paper", "dynamic m", "static m", "average m", "AAE rad")
    return [
        dict(zip(keys, ("-" if cell is None else cell for cell in line), strict=True))
        for line in PAPER
    ]


def answer(source: FlowSource, pair: HeldOut, index: int) -> FlowSamples:
    source.reset()
    for frame in pair.frames:
        if isinstance(source, FrameObserver):
            source.observe(frame)
    return pair.samples(source.estimate(pair.previous, pair.current), index)


def row(name: str, samples: FlowSamples) -> dict[str, object]:
    dynamic, static = samples.select(samples.dynamic), samples.select(~samples.dynamic)
    parts = {"dynamic": flow_error(dynamic), "static": flow_error(static)}
    seen = flow_error(samples.select(samples.dynamic & samples.observable))
    everything = flow_error(samples)
    return {
        "source": name,
        "RMSE dynamic m/s": parts["dynamic"].rmse_mps,
        "static": parts["static"].rmse_mps,
        "average": everything.rmse_mps,
        "dynamic m": parts["dynamic"].rmse_m,
        "static m": parts["static"].rmse_m,
        "average m": everything.rmse_m,
        "AAE rad": everything.aae_rad,
        "AAE dynamic": parts["dynamic"].aae_rad,
        "median dynamic": parts["dynamic"].median_mps,
        "within 1 m/s": parts["dynamic"].within_1_mps,
        "seen RMSE": seen.rmse_mps,
        "static > 1 m/s": 1.0 - parts["static"].within_1_mps,
    }


def main() -> None:
    given = arguments(__doc__ or "", pairs=int, rows=str, ablation=Path)
    table = sources(given.ablation)
    wanted = given.rows.split(",") if given.rows else list(table)
    made = {name: table[name]() for name in wanted}
    collected: dict[str, list[FlowSamples]] = {name: [] for name in wanted}
    count = given.pairs or (6 if given.quick else 60)
    for index, pair in enumerate(held_out_pairs(count, BevGrid())):
        for name, source in made.items():
            collected[name].append(answer(source, pair, index))
    report(printed())
    print()
    report([row(name, FlowSamples.stacked(parts)) for name, parts in collected.items()], given.json)


if __name__ == "__main__":
    main()

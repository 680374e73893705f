"""Flow error of DOGMa and other sources after ten cycles of warm-up, on held-out data.

    python benchmarks/dogma_flow.py [--on world,pandaset,kitti] [--rows zero,dogma] [--cell 0.25] \
        [--data FOLDER] [--json FILE] [--quick]

Twenty held-out scenes of the embedded world (each with a sensor and a place of its own),
PandaSet-002 and KITTI 0000 (`_real_pairs`). A source with state sees every sweep; all are scored on
the same occupied cells, of five consecutive pairs a scene after the warm-up in the embedded world,
of every second pair after it in a drive. A cell that a source did not measure counts as zero; a
cell is dynamic above 0.5 m/s. `icp` takes the detections of the embedded world and the true boxes
of the drives. `ms` is the median CPU time of a pair. `--quick`: three scenes, every tenth pair.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from _real_pairs import Drive, cell_truth, read_kitti, read_pandaset
from flow_real import scores
from numpy.typing import NDArray

from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.sweep import Sweep
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset, SyntheticScene
from mottrack.flow.cluster_icp import ClusterIcpFlow
from mottrack.flow.dogma.source import DogmaFlow
from mottrack.flow.icp import IcpConfig, IcpFlow
from mottrack.flow.pillarflow.source import PillarFlow, PillarFlowConfig
from mottrack.flow.sweep_pair import GroundStage, obstacle_points
from mottrack.flow.zero import ZeroFlow

SEED = 770_001
"""No training set uses it."""
WARM_UP = 10
PAIRS = 5
Cells = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating[Any]]]
"""Rows, columns and true velocities (C, 2) of occupied cells."""
Sources = dict[str, FlowSource]


@dataclass(frozen=True)
class Moment:
    """Two consecutive sweeps with their frames, and the truth where they are scored."""

    frames: tuple[Frame, Frame]
    sweeps: tuple[Sweep, Sweep]
    truth: Cells | None


@dataclass
class Tally:
    """Estimates of one source, the truth, and the time."""

    estimates: list[NDArray[Any]]
    truths: list[NDArray[Any]]
    milliseconds: list[float]

    def line(self) -> dict[str, float]:
        figures = scores(np.concatenate(self.estimates), np.concatenate(self.truths))
        return {**figures, "ms": float(np.median(self.milliseconds))}


def world(count: int, grid: BevGrid) -> Iterator[Iterator[Moment]]:
    """Scenes of the embedded world, as long as the warm-up and the scored pairs need."""
    duration_s = 0.1 * (WARM_UP + PAIRS + 1)
    config = SyntheticConfig(scenes=count, seed=SEED, duration_s=duration_s, sensor="random")
    dataset = SyntheticDataset(config)
    for name in dataset.scene_names:
        scene = dataset.scene(name)
        yield (_in_world(scene, index, grid) for index in range(1, len(scene)))


def _in_world(scene: SyntheticScene, index: int, grid: BevGrid) -> Moment:
    frames = scene.frame(index - 1), scene.frame(index)
    sweeps = scene.sweep(index - 1), scene.sweep(index)
    return Moment(frames, sweeps, world_truth(scene, index, grid) if index > WARM_UP else None)


def world_truth(scene: SyntheticScene, index: int, grid: BevGrid) -> Cells:
    """The mean velocity of the obstacle points of each occupied cell."""
    sweep = scene.sweep(index)
    numbered = replace(sweep, time_offset_ns=np.arange(len(sweep)))
    obstacles, _ = obstacle_points(numbered, GroundStage())
    velocity_mps = scene.sweep_truth(index).velocity_mps[obstacles.time_offset_ns]
    rows, cols, inside = grid.cells(obstacles.xyz_m)
    flat = (rows * grid.shape[1] + cols)[inside]
    hit, slot, count = np.unique(flat, return_inverse=True, return_counts=True)
    sums = [np.bincount(slot, velocity_mps[inside, axis]) for axis in range(2)]
    return *np.divmod(hit, grid.shape[1]), (np.stack(sums) / count).T.astype(np.float32)


def drive(recorded: Drive, every: int, grid: BevGrid) -> Iterator[Iterator[Moment]]:
    """A recorded drive as one scene."""
    yield (_in_drive(recorded, i, every, grid) for i in range(1, len(recorded.sweeps)))


def _in_drive(recorded: Drive, index: int, every: int, grid: BevGrid) -> Moment:
    frames = recorded.frame(index - 1), recorded.frame(index)
    sweeps = recorded.sweeps[index - 1], recorded.sweeps[index]
    if index <= WARM_UP or index % every:
        return Moment(frames, sweeps, None)
    truth = cell_truth(recorded, index, grid)
    return Moment(frames, sweeps, (truth.rows, truth.cols, truth.velocity_mps))


def sources(grid: BevGrid, *, boxes_are_true: bool) -> dict[str, Callable[[], FlowSource]]:
    """Name of a row -> how to make its source."""
    one = IcpConfig(use_truth=boxes_are_true, starts=1)
    many = IcpConfig(use_truth=boxes_are_true)
    return {
        "zero": lambda: ZeroFlow(grid=grid),
        "icp_one_start": lambda: IcpFlow(one, grid=grid),
        "icp": lambda: IcpFlow(many, grid=grid),
        "cluster_icp": lambda: ClusterIcpFlow(grid=grid),
        "dogma": lambda: DogmaFlow(grid=grid),
        "pillarflow_raw": lambda: PillarFlow(PillarFlowConfig(refined=False), grid=grid),
        "pillarflow": lambda: PillarFlow(grid=grid),
    }


def run(scenes: Iterator[Iterator[Moment]], made: Sources) -> dict[str, dict[str, float]]:
    """Figures by source."""
    tallies = {name: Tally([], [], []) for name in made}
    for scene in scenes:
        for source in made.values():
            source.reset()
        for moment in scene:
            for name, source in made.items():
                ask(source, moment, tallies[name])
    return {name: tally.line() for name, tally in tallies.items()}


def ask(source: FlowSource, moment: Moment, tally: Tally) -> None:
    """Give a source the sweeps and, where they are scored, store its estimate."""
    if moment.truth is None and not source.stateful:
        return
    if isinstance(source, FrameObserver):
        for frame in moment.frames:
            source.observe(frame)
    start = time.process_time()
    field = source.estimate(moment.sweeps[:1], moment.sweeps[1])
    tally.milliseconds.append(1e3 * (time.process_time() - start))
    if moment.truth is None:
        return
    rows, cols, truth_mps = moment.truth
    known_mps = np.where(field.valid[..., None], field.velocity_mps, 0.0)
    tally.estimates.append(known_mps[rows, cols])
    tally.truths.append(truth_mps)


def main() -> None:
    options = arguments(__doc__ or "", on=str, rows=str, cell=float, data=Path)
    grid, shared = BevGrid(cell_m=options.cell or 0.25), recorded_data(options.data)
    scenes, every = (3, 10) if options.quick else (20, 2)
    places: dict[str, Callable[[], Iterator[Iterator[Moment]]]] = {
        "world": lambda: world(scenes, grid),
        "pandaset": lambda: drive(
            read_pandaset(shared / "argoverse2" / "val" / "pandaset-002"), every, grid
        ),
        "kitti": lambda: drive(read_kitti(shared / "kitti_tracking"), every, grid),
    }
    lines: list[dict[str, Any]] = []
    for place in options.on.split(",") if options.on else places:
        table = sources(grid, boxes_are_true=place != "world")
        names = options.rows.split(",") if options.rows else list(table)
        figures = run(places[place](), {name: table[name]() for name in names})
        lines += [{"on": place, "source": name, **line} for name, line in figures.items()]
    report(lines, options.json)


if __name__ == "__main__":
    main()

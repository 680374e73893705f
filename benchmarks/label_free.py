"""How well scores without labels rank flow sources: against the truth, drive by drive.

    python benchmarks/label_free.py [--data FOLDER] [--rows zero,cluster_icp] [--json FILE] \
        [--quick]

Drives: PandaSet 002 and 002b, KITTI 0000 (`_real_pairs`) and three seeds of the embedded world, one
of them with another sensor. Every source is scored on the same sweeps by truth (RMSE of occupied
cells in m/s, as in `flow_real`) and without it (`mottrack.pipeline.label_free`). The last table is
Kendall's tau between the two over the sources of a drive: 1 is the same order, 0 none; zero
flow is one of the sources. `--quick` takes every fourth of the pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from _real_pairs import Drive, cell_truth, read_kitti, read_pandaset
from flow_real import ROWS
from scipy.stats import kendalltau

from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import MOVING_MPS, FlowField
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.eval.label_free import (
    CONSISTENT,
    ERROR,
    EXPLAINED,
    MOVING,
    STATIC,
    LabelFreeSums,
    SceneJudgements,
)
from mottrack.eval.paired import MetricKey, whole
from mottrack.pipeline.label_free import Evidence, Reversal
from mottrack.pipeline.label_free_sampler import Evidences
from mottrack.pipeline.mirrored import mirrored_frame, mirrored_sweep

SOURCES = (
    "zero,icp_oracle_one,icp_oracle_many,cluster_icp,binary_ogm_raw,binary_ogm,"
    "pillarflow_small_raw,pillarflow_small,pillarflow_raw,pillarflow"
)
"""DOGMa is left out: it filters over time, so it has no reversed pair."""
CHECK_STEPS = 3
"""Sweeps back to the earlier sweep: 0.3 s at 10 Hz, as `pipeline.label_free.CHECK_S`."""
FIRST = 4
"""First pair: each has an earlier sweep."""
PAIRS = 8
"""Of a drive, evenly spread: nearly as many as the shortest drive has."""
FIGURES = {"error": ERROR, "moving": MOVING, "static": STATIC, "explained": EXPLAINED}
FIGURES["consistent"] = CONSISTENT
TRUTHS = ("RMSE", "dynamic RMSE", "static RMSE")


def embedded(seed: int, sensor: str = "uniform32") -> Drive:
    """Make 4 s of the embedded world with truth at every sweep."""
    config = SyntheticConfig(scenes=1, seed=seed, duration_s=4.0, key_hz=10, sensor=sensor)
    dataset = SyntheticDataset(config)
    scene = dataset.scene(dataset.scene_names[0])
    frames = range(len(scene))
    truth = [scene.frame(i).truth for i in frames]
    return Drive.of(f"embedded {seed}", [scene.sweep(i) for i in frames], truth, np.pi)


def drives(shared: Path) -> Iterator[Drive]:
    """Read the drives, one after the other."""
    yield read_pandaset(shared / "argoverse2" / "val" / "pandaset-002")
    yield read_pandaset(shared / "argoverse2_driving" / "val" / "pandaset-002b")
    yield read_kitti(shared / "kitti_tracking")
    yield embedded(7001)
    yield embedded(8001)
    yield embedded(9001, "random")


def forward(source: FlowSource, drive: Drive, index: int) -> FlowField:
    """Measure the motion since the sweeps before."""
    source.reset()
    if isinstance(source, FrameObserver):
        for i in (index - 1, index):
            source.observe(drive.frame(i))
    oldest = max(index - source.past_sweeps, 0)
    return source.estimate(drive.sweeps[oldest:index], drive.sweeps[index])


def backward(source: FlowSource, drive: Drive, index: int) -> FlowField:
    """Measure the same pair with time turned about its later sweep."""
    about_ns = drive.sweeps[index].stamp_ns
    source.reset()
    if isinstance(source, FrameObserver):
        for i in (index, index - 1):
            source.observe(mirrored_frame(drive.frame(i), about_ns))
    past, current = (mirrored_sweep(drive.sweeps[i], about_ns) for i in (index, index - 1))
    return source.estimate((past,), current)


def compare(drive: Drive, sources: dict[str, FlowSource], grid: BevGrid, quick: bool) -> list[Any]:
    """Return a row of figures for each source."""
    last = len(drive.sweeps) - 1
    indices = np.unique(np.linspace(FIRST, last, PAIRS // 4 if quick else PAIRS).astype(int))
    sums = dict.fromkeys(sources, LabelFreeSums())
    squares = {name: np.zeros((2, 2)) for name in sources}
    evidences = Evidences()
    for index in indices.tolist():
        current, before = drive.sweeps[index], drive.sweeps[index - 1]
        evidence: Evidence = evidences.of(drive.sweeps[index - CHECK_STEPS], current)
        truth = cell_truth(drive, index, grid)
        dynamic = np.hypot(*truth.velocity_mps.T) > MOVING_MPS
        for name, source in sources.items():
            field = forward(source, drive, index)
            sums[name] += evidence.judge(field)
            reversal = Reversal(backward(source, drive, index), evidences.prepared(before, current))
            sums[name] += reversal.agreement(evidence, field)
            known_mps = np.where(field.valid[..., None], field.velocity_mps, 0.0)
            error = known_mps[truth.rows, truth.cols] - truth.velocity_mps
            square = (error**2).sum(axis=1)
            for row, mask in enumerate((dynamic, ~dynamic & ~truth.rim)):
                squares[name][row] += square[mask].sum(), mask.sum()
    return [_row(drive, name, sums[name], squares[name]) for name in sources]


def _row(drive: Drive, name: str, sums: LabelFreeSums, squares: Any) -> dict[str, Any]:
    judged = SceneJudgements((sums,))
    parts = [squares.sum(axis=0), *squares]
    true = {key: float(np.sqrt(p[0] / p[1])) for key, p in zip(TRUTHS, parts, strict=True)}
    values = {key: whole(judged.metric(metric)) for key, metric in FIGURES.items()}
    return {"drive": drive.name, "source": name, **true, **values}


def taus(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return Kendall's tau of each figure with each RMSE: mean and least over the drives."""
    names = list(dict.fromkeys(row["drive"] for row in rows))
    found: list[dict[str, Any]] = []
    for figure, key in FIGURES.items():
        line: dict[str, Any] = {"figure": figure}
        for true in TRUTHS:
            values = [_tau([r for r in rows if r["drive"] == n], figure, true, key) for n in names]
            line |= {true: float(np.mean(values)), f"least, {true}": float(np.min(values))}
        found.append(line)
    return found


def _tau(rows: list[dict[str, Any]], figure: str, true: str, key: MetricKey) -> float:
    sign = 1.0 if key.lower_is_better else -1.0
    return float(kendalltau([sign * r[figure] for r in rows], [r[true] for r in rows]).statistic)


def main() -> None:
    options = arguments(__doc__ or "", data=Path, rows=str)
    grid = BevGrid(cell_m=0.5)
    makers: dict[str, Callable[[BevGrid], FlowSource]] = {
        name: ROWS[name] for name in (options.rows or SOURCES).split(",")
    }
    sources = {name: make(grid) for name, make in makers.items()}
    rows: list[dict[str, Any]] = []
    for drive in drives(recorded_data(options.data)):
        rows += compare(drive, sources, grid, options.quick)
    report(rows, options.json)
    print()
    report(taus(rows))


if __name__ == "__main__":
    main()

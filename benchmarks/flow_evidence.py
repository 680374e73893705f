"""Fit the odds by which the refinement keeps or withdraws a claimed motion, leaving drives out.

    python benchmarks/flow_evidence.py [--data FOLDER] [--seeds 7001,8001] [--json FILE] [--quick]

Components that the raw network claims to move, on recorded drives and scenes of the embedded world,
with what the refinement measures of each: the mean significance over the past sweeps, the
logarithm of the mean ratio of costs, and the logarithm of the speed. The true answer is whether the
cells of the component move by more than 0.5 m/s. Each drive has the same weight, and each of three
choices of past sweeps, since a stream begins with few.

The table has one line for each drive left out (both PandaSet drives are one place): area under the
curve, share of the cells of movers that are withdrawn, resting cells that keep a motion, and
mean d^2 / 2 and share within the second contour of the movers' fused velocities. The last lines are
the weights of all drives, which `mottrack.flow.registration.motions.ODDS` holds, and their spread.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from _real_pairs import Drive, cell_truth, read_kitti, read_pandaset

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.grid import BevGrid
from mottrack.core.motion import MOVING_MPS
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.flow.pillarflow.source import PillarFlow, PillarFlowConfig
from mottrack.flow.registration.motions import MIN_POINTS
from mottrack.flow.registration.refine import RefineConfig, refine_components

PASTS = ((2, 5), (2,), (1, 5))
"""Sweeps back, the network's first: the default, the start of a drive, and a short baseline."""
OLDEST = 5
"""Half a second at 10 Hz."""
PENALTY = 1.0
"""Of the squared weights: one component's worth, so that no weight runs away on separable data."""
EACH = 300.0
"""Components that each drive counts as, about their number in one."""
STEPS = 60
"""Of Newton's method; a dozen suffice."""
SECOND_CONTOUR = 4.0
"""Squared Mahalanobis distance of the second contour."""


@dataclass(frozen=True)
class Components:
    """K claimed components of one drive."""

    evidence: F64
    """(K, 3) what `ODDS` weighs."""
    moves: Mask
    """(K,) the true answer."""
    cells: I64
    """(K,) cells of each."""
    squared: F64
    """(K,) e' C^-1 e of the fused velocity."""
    registered: Mask
    """(K,) with enough points for a registration."""


def components(drive: Drive, source: PillarFlow, back: tuple[int, ...], every: int) -> Components:
    """Return the components of a drive with these past sweeps."""
    parts: list[tuple[Any, ...]] = []
    for index in range(OLDEST, len(drive.sweeps), every):
        past = [drive.sweeps[index - k] for k in reversed(back)]
        pair = source.stages.before([*past[:-1], past[-1]], drive.sweeps[index])
        field = source.raw(pair)
        found = refine_components(field, pair, RefineConfig())
        truth = cell_truth(drive, index, field.grid)
        if found is None:
            continue
        owner, motions = found.cells[truth.rows, truth.cols], found.motions
        for k in range(len(motions.points)):
            own = (owner == k) & ~truth.rim
            if not own.any() or not motions.points[k]:
                continue
            true_mps = np.median(truth.velocity_mps[own], axis=0)
            error = motions.velocity_mps[k] - true_mps
            squared = error @ np.linalg.inv(motions.covariance_m2ps2[k]) @ error
            moves, enough = np.hypot(*true_mps) > MOVING_MPS, motions.points[k] >= MIN_POINTS
            parts.append((motions.evidence[k], moves, own.sum(), squared, enough))
    columns = [np.array(column) for column in zip(*parts, strict=True)]
    return Components(*columns)


def fitted(parts: list[Components]) -> F64:
    """Return (4,) the constant and the weights of the logistic regression, by Newton's method."""
    x = np.concatenate([np.column_stack([np.ones(len(p.moves)), p.evidence]) for p in parts])
    y = np.concatenate([p.moves for p in parts]).astype(np.float64)
    weight = np.concatenate([np.full(len(p.moves), EACH / len(p.moves)) for p in parts])
    penalty = PENALTY * np.diag([1e-6, 1.0, 1.0, 1.0])
    odds = np.zeros(4)
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-x @ odds))
        slope = x.T @ (weight * (y - p)) - penalty @ odds
        curvature = (x * (weight * p * (1 - p))[:, None]).T @ x + penalty
        odds += np.linalg.solve(curvature, slope)
    return odds


def judged(part: Components, odds: F64, least: float) -> dict[str, float]:
    """Return the figures of one drive under these weights."""
    log_odds = odds[0] + part.evidence @ odds[1:]
    kept = log_odds >= np.log(least / (1.0 - least))
    moves, cells = part.moves, part.cells
    order = np.argsort(log_odds)
    rank = np.arange(1, len(order) + 1)[moves[order]].sum()
    pairs = max(int(moves.sum() * (~moves).sum()), 1)
    squared = part.squared[moves & kept & part.registered]
    counted = cells[moves & kept & part.registered]
    return {
        "components": len(moves),
        "area": float((rank - moves.sum() * (moves.sum() + 1) / 2) / pairs),
        "withdrawn_movers_%": float(100 * cells[moves & ~kept].sum() / max(cells[moves].sum(), 1)),
        "kept_resting_cells": int(cells[~moves & kept].sum()),
        "d2/2": float((counted * squared).sum() / counted.sum() / 2),
        "2 sigma_%": float(100 * (counted * (squared < SECOND_CONTOUR)).sum() / counted.sum()),
    }


def world(seed: int) -> Drive:
    """Return a scene of the embedded world as a drive."""
    config = SyntheticConfig(seed=seed, scenes=1, duration_s=4.0, key_hz=10, sensor="random")
    data = SyntheticDataset(config)
    scene = data.scene(data.scene_names[0])
    indices = range(len(scene))
    truth = [scene.frame(i).truth for i in indices]
    return Drive.of(f"world {seed}", [scene.sweep(i) for i in indices], truth, np.pi)


def drives(shared: Path, seeds: list[int]) -> Iterator[Drive]:
    yield read_pandaset(shared / "argoverse2" / "val" / "pandaset-002")
    yield read_pandaset(shared / "argoverse2_driving" / "val" / "pandaset-002b")
    yield read_kitti(shared / "kitti_tracking")
    yield from (world(seed) for seed in seeds)


def main() -> None:
    options = arguments(__doc__ or "", data=Path, seeds=str)
    seeds = [int(seed) for seed in (options.seeds or "7001,8001,9001,11001").split(",")]
    source = PillarFlow(PillarFlowConfig(refined=False), grid=BevGrid(cell_m=0.5))
    every = 5 if options.quick else 1
    found: dict[str, list[Components]] = {}
    for drive in drives(recorded_data(options.data), seeds):
        found[drive.name] = [components(drive, source, back, every) for back in PASTS]
    least = RefineConfig().least_probability
    lines, weights = [], []
    for name, own in found.items():
        place = name.split()[0] if name.startswith("PandaSet") else name
        rest = [part for other, parts in found.items() if place not in other for part in parts]
        odds = fitted(rest)
        weights.append(odds)
        for back, part in zip(PASTS, own, strict=True):
            lines.append({"left out": name, "sweeps back": str(back), **judged(part, odds, least)})
    report(lines, options.json)
    everything = fitted([part for parts in found.values() for part in parts])
    print("\nconstant, significance, ratio, speed:", np.round(everything, 2).tolist())
    print("their spread over the drives left out:", np.round(np.std(weights, axis=0), 2).tolist())


if __name__ == "__main__":
    main()

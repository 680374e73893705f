"""Fit the odds by which the refinement keeps or withdraws a claimed motion, leaving drives out.

    python benchmarks/flow_evidence.py [--data FOLDER] [--seeds 7001,8001] [--json FILE] [--quick]

Components that the raw network claims to move, on recorded drives and scenes of the embedded world,
with what the refinement measures of each: the mean significance over the past sweeps, the
logarithm of the mean ratio of costs, that of the speed, and how much is absent at rest. The true
answer is whether the cells of the component move by more than 0.5 m/s. A component weighs as the
root of its cells: the field is made of cells, whose errors are alike within a component. The
recorded drives together weigh as much as the scenes of the world together, and each of three
choices of past sweeps the same, since a stream begins with few.

The table has one line for each drive left out (both PandaSet drives are one place): area under the
curve, log loss by component and by cell, share of the cells of movers that are withdrawn (of all,
and of those of 2 to 10 m/s), resting cells that keep a motion, and mean d^2 / 2 and share within
the second contour of the movers' fused velocities. The last lines are the weights of all drives,
which `mottrack.flow.registration.motions.ODDS` holds, and their spread.
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
SEEDS = "7001,8001,9001,11001,30001,31001,32001,33001," + ",".join(
    str(seed) for seed in range(51001, 63001, 1000)
)
"""Twenty scenes of the embedded world that no training uses."""
SIDE = 1800.0
"""Components that the recorded drives count as together, about their number, and the scenes of the
world together."""
WORLD = "world"
"""First word of the name of a scene of the embedded world."""
MIDDLE_MPS = (2.0, 10.0)
"""Speeds of movers whose withdrawal is a gross error: faster than walking, slower than the rare."""
STEPS = 60
"""Of Newton's method; a dozen suffice."""
SECOND_CONTOUR = 4.0
"""Squared Mahalanobis distance of the second contour."""


@dataclass(frozen=True)
class Components:
    """K claimed components of one drive."""

    evidence: F64
    """(K, 4) what `ODDS` weighs."""
    speed_mps: F64
    """(K,) true speed."""
    cells: I64
    """(K,) cells of each."""
    squared: F64
    """(K,) e' C^-1 e of the fused velocity."""
    registered: Mask
    """(K,) with enough points for a registration."""

    @property
    def moves(self) -> Mask:
        """(K,) the true answer."""
        moves: Mask = self.speed_mps > MOVING_MPS
        return moves


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
            enough = motions.points[k] >= MIN_POINTS
            speed_mps = np.hypot(*true_mps)
            parts.append((motions.evidence[k], speed_mps, own.sum(), squared, enough))
    columns = [np.array(column) for column in zip(*parts, strict=True)]
    return Components(*columns)


def fitted(found: dict[str, list[Components]]) -> F64:
    """Return (5,) the constant and the weights of the logistic regression, by Newton's method."""
    scenes = sum(name.startswith(WORLD) for name in found)
    x, y, weight = [], [], []
    for name, parts in found.items():
        of_side = scenes if name.startswith(WORLD) else len(found) - scenes
        for part in parts:
            x.append(np.column_stack([np.ones(len(part.moves)), part.evidence]))
            y.append(part.moves.astype(np.float64))
            root = np.sqrt(part.cells)
            weight.append(root / root.sum() * SIDE / of_side / len(parts))
    return logistic(np.concatenate(x), np.concatenate(y), np.concatenate(weight))


def logistic(x: F64, y: F64, weight: F64) -> F64:
    """Return the odds (F,) of answers (K,) from features (K, F), the first constant."""
    penalty = PENALTY * np.diag([1e-6] + [1.0] * (x.shape[1] - 1))
    odds = np.zeros(x.shape[1])
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
    loss = np.logaddexp(0.0, np.where(moves, -log_odds, log_odds))
    middle = (part.speed_mps > MIDDLE_MPS[0]) & (part.speed_mps < MIDDLE_MPS[1])
    squared = part.squared[moves & kept & part.registered]
    counted = cells[moves & kept & part.registered]
    return {
        "components": len(moves),
        "area": float((rank - moves.sum() * (moves.sum() + 1) / 2) / pairs),
        "log_loss": float(loss.mean()),
        "of_cells": float(np.average(loss, weights=cells)),
        "withdrawn_movers_%": share(cells, moves, ~kept),
        "2_to_10_mps_%": share(cells, middle, ~kept),
        "kept_resting_cells": int(cells[~moves & kept].sum()),
        "d2/2": float((counted * squared).sum() / counted.sum() / 2),
        "2 sigma_%": float(100 * (counted * (squared < SECOND_CONTOUR)).sum() / counted.sum()),
    }


def share(cells: I64, of: Mask, chosen: Mask) -> float:
    """Return the chosen share of some cells in percent."""
    return float(100 * cells[of & chosen].sum() / max(cells[of].sum(), 1))


def world(seed: int) -> Drive:
    """Return a scene of the embedded world as a drive."""
    config = SyntheticConfig(seed=seed, scenes=1, duration_s=4.0, key_hz=10, sensor="random")
    data = SyntheticDataset(config)
    scene = data.scene(data.scene_names[0])
    indices = range(len(scene))
    truth = [scene.frame(i).truth for i in indices]
    return Drive.of(f"{WORLD} {seed}", [scene.sweep(i) for i in indices], truth, np.pi)


def drives(shared: Path, seeds: list[int]) -> Iterator[Drive]:
    yield read_pandaset(shared / "argoverse2" / "val" / "pandaset-002")
    yield read_pandaset(shared / "argoverse2_driving" / "val" / "pandaset-002b")
    yield read_kitti(shared / "kitti_tracking")
    yield from (world(seed) for seed in seeds)


def main() -> None:
    options = arguments(__doc__ or "", data=Path, seeds=str)
    seeds = [
        int(seed)
        for seed in (options.seeds or "7001,8001,9001,11001,30001,31001,32001,33001").split(",")
    ]
    source = PillarFlow(PillarFlowConfig(refined=False), grid=BevGrid(cell_m=0.5))
    every = 5 if options.quick else 1
    found: dict[str, list[Components]] = {}
    for drive in drives(recorded_data(options.data), seeds):
        found[drive.name] = [components(drive, source, back, every) for back in PASTS]
    least = RefineConfig().least_probability
    lines, weights = [], []
    for name, own in found.items():
        place = name.split()[0] if name.startswith("PandaSet") else name
        rest = {other: parts for other, parts in found.items() if place not in other}
        odds = fitted(rest)
        weights.append(odds)
        for back, part in zip(PASTS, own, strict=True):
            lines.append({"left out": name, "sweeps back": str(back), **judged(part, odds, least)})
    report(lines, options.json)
    everything = fitted(found)
    print("\nconstant, significance, ratio, speed, absent:", np.round(everything, 2).tolist())
    print("their spread over the drives left out:", np.round(np.std(weights, axis=0), 2).tolist())


if __name__ == "__main__":
    main()

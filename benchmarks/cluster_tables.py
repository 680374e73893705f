"""Table IV for clusters and the fixed-lag tracker: velocity error by category and flow source.

    python benchmarks/cluster_tables.py world
    python benchmarks/cluster_tables.py pandaset --data .../argoverse2
    python benchmarks/cluster_tables.py kitti --data .../kitti_tracking [--velodyne FOLDER]

Mean and worst 5 % of |v_track - v_true| in m/s, and the number of track rows. `world` runs the 20
held-out scenes of `configs/clusters.yaml`, 1.7 s each at 10 Hz; settings were chosen on other
seeds. Results are kept in `--out` and taken up again by the next call: give a fresh folder after a
change of code or weights. The same runs by hand:

    mottrack compare clusters dataset.duration_s=1.7 --out out/clusters/world
    mottrack compare clusters dataset=argoverse2 dataset.root=... 'scenes=["pandaset-002"]' ...
    mottrack compare clusters dataset=kitti dataset.root=... 'scenes=["0000"]' ...
"""

from __future__ import annotations

import argparse
from pathlib import Path

from _common import report

from mottrack.eval.velocity_error import CATEGORIES, OTHER
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.comparison import Comparison, run_comparison
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.runner import Execution
from mottrack.runs.tasks import Outcome

ROWS = (*CATEGORIES, "all", OTHER)


class LinePerScene:
    """Says what has been run, one line a scene."""

    def begin(self, title: str, scenes: int, todo: int) -> None:
        print(f"{title}: {todo} of {scenes} scenes to run", flush=True)

    def frames(self, scene: str, done: int, total: int) -> None:
        """Nothing is said between scenes."""

    def scene_ends(self, outcome: Outcome) -> None:
        print(f"  {outcome.scene} {outcome.error or 'done'}", flush=True)


def overrides(data: str, root: Path | None, velodyne: Path | None, quick: bool) -> list[str]:
    """What distinguishes each data set from the shipped configuration."""
    if data == "world":
        return ["dataset.duration_s=1.7", *(["dataset.scenes=2"] if quick else [])]
    kind, scene = {"pandaset": ("argoverse2", "pandaset-002"), "kitti": ("kitti", "0000")}[data]
    found = [f"dataset={kind}", f"dataset.root={root}", f'scenes=["{scene}"]']
    if velodyne is not None:
        found.append(f"dataset.velodyne_root={velodyne}")
    return [*found, "dataset.require_sweeps=true"]


def table(comparison: Comparison) -> list[dict[str, object]]:
    """A line a flow source: "mean worst (rows)" of each category."""
    lines = []
    for run in comparison.runs:
        line: dict[str, object] = {"flow": run.experiment.flow.kind}
        for row in ROWS:
            found = run.velocity_error(row)
            line[row] = f"{found.mean_mps:.3f} {found.worst_mean_mps:.2f} ({found.count})"
        lines.append(line)
    return lines


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", choices=("world", "pandaset", "kitti"))
    parser.add_argument("--data", type=Path, help="root of the data set")
    parser.add_argument("--velodyne", type=Path, help="unpacked sweeps, where they lie elsewhere")
    parser.add_argument("--out", type=Path, default=Path("out/clusters"))
    parser.add_argument("--flow", help="only these sources, with commas")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="two scenes of the embedded world")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    return parser.parse_args()


def main() -> None:
    options = arguments()
    chosen = overrides(options.dataset, options.data, options.velodyne, options.quick)
    if options.flow:
        chosen.append(f"flow={options.flow}")
    experiments = load_experiments("clusters", chosen)
    out, workers = options.out / options.dataset, options.workers
    comparison = run_comparison(
        experiments, out, execution=Execution(LocalPool(workers)), progress=LinePerScene()
    )
    report(table(comparison), options.json)


if __name__ == "__main__":
    main()

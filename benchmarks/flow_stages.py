"""Milliseconds of every part of PillarFlow's `estimate` on recorded drives, past sweeps included.

    python benchmarks/flow_stages.py [--data FOLDER] [--threads 2,1] [--precision auto,fp32]
        [--weights base] [--json FILE] [--quick]

Each drive is gone through several times; of a sweep the fastest time of each part counts, of a
drive the median over its sweeps. The first time compiles and is left out. `before` is ground,
alignment and visibility, `network` pillars and network, `after` verification and refinement;
`around` is all but the network.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, recorded_data, report
from _real_pairs import Drive, read_kitti, read_pandaset

from mottrack.flow.pillarflow.engine import use_threads
from mottrack.flow.pillarflow.source import PillarFlow, PillarFlowConfig

SWEEPS = (8, 14)
"""First and last sweep that are timed: a whole past lies before them."""
PASSES = {True: 3, False: 8}
"""Through a drive, quick or not; the first compiles."""

CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "CPU": time.process_time}


class TimedFlow:
    """A source whose parts are timed."""

    def __init__(self, config: PillarFlowConfig) -> None:
        self.source = PillarFlow(config)
        self.times: dict[str, list[float]] = defaultdict(list)
        stages, engine = self.source.stages, self.source._engine
        for owner, method, part in (
            (stages, "before", "before"),
            (engine, "run", "network"),
            (stages, "after", "after"),
            (self.source, "estimate", "all"),
        ):
            setattr(owner, method, self._timed(getattr(owner, method), part))

    def _timed(self, method: Callable[..., Any], part: str) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            start = {name: clock() for name, clock in CLOCKS.items()}
            result = method(*given)
            for name, clock in CLOCKS.items():
                self.times[f"{part} {name}"].append(1e3 * (clock() - start[name]))
            return result

        return timed

    def measure(self, drive: Drive, passes: int) -> dict[str, float]:
        """Return the milliseconds of each part."""
        first, last = SWEEPS
        found: dict[str, list[list[float]]] = defaultdict(list)
        for _ in range(passes):
            self.source.reset()
            self.times.clear()
            for k in range(first, min(last, len(drive.sweeps) - 1) + 1):
                past = drive.sweeps[k - self.source.past_sweeps : k]
                self.source.estimate(past, drive.sweeps[k])
            for part, times in self.times.items():
                found[part].append(times)
        # the first sweep after a reset has no features of its past: a stream has
        fastest = {part: np.min(times[1:], axis=0)[1:] for part, times in found.items()}
        for clock in CLOCKS:
            fastest[f"around {clock}"] = fastest[f"all {clock}"] - fastest[f"network {clock}"]
        return {part: float(np.median(times)) for part, times in fastest.items()}


def main() -> None:
    options = arguments(__doc__ or "", data=Path, threads=str, precision=str, weights=str)
    shared = recorded_data(options.data)
    drives = [
        read_pandaset(shared / "argoverse2" / "val" / "pandaset-002"),
        read_pandaset(shared / "argoverse2_driving" / "val" / "pandaset-002b"),
        read_kitti(shared / "kitti_tracking"),
    ]
    rows = []
    for threads in (options.threads or "2,1").split(","):
        use_threads(int(threads))
        for precision in (options.precision or "auto").split(","):
            config = PillarFlowConfig.model_validate(
                {"weights": options.weights or "base", "precision": precision}
            )
            timed = TimedFlow(config)
            for drive in drives[:1] if options.quick else drives:
                told = {"drive": drive.name, "threads": threads, "precision": precision}
                points = {"points": len(drive.sweeps[SWEEPS[0]])}
                rows.append(told | points | timed.measure(drive, PASSES[options.quick]))
    report(rows, options.json)


if __name__ == "__main__":
    main()

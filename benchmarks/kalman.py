"""Frames a second of the Kalman tracker's engines and of its peers, on one core.

All track the same detections in the same run: road users of seven classes at a constant density,
10 Hz, a recall of 95 %. Every row's tracks are scored against the known truth by the official
rules, and a time counts only where recall and precision are high enough (`_workload.check`). Ours,
kinematic-tracker and pure-ab-3d-mot track boxes; norfair and Stone Soup, which have none, the
centre in the plane. The peers need `make peers` and are left out without it.

CPU time (`time.process_time`) of the trackers' own step, the first frames left out: tracks are born
there. `growth`: the power of the number of objects by which a frame's time grows; 1 is linear.
"""

from __future__ import annotations

import os
import time
from typing import Any, NamedTuple

os.environ.update({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})

import numpy as np
from _common import arguments, report
from _peers import PEERS, run_peer
from _workload import Workload, check, workload

from mottrack.core.tables import TrackTable
from mottrack.trackers import KalmanTracker

WARM_UP = 5
"""Frames that are not timed: tracks are born there."""
LADDER = (60, 300, 1000)
"""Numbers of objects over which the growth is fitted."""
SLOW = {"filterpy engine", *PEERS}
"""Trackers that take fewer frames, once."""
FEW_FRAMES = {True: 20, False: 10}
"""Of the slow ones, for up to a hundred objects and for more."""

QUICK_PEERS = 60
"""Objects up to which a quick run has the peers."""

OURS: dict[str, dict[str, Any]] = {
    "mottrack published preset": {"preset": "stanford_iprl_tri"},
    "mottrack default": {},
    "mottrack default, velocities": {},
    "filterpy engine": {"preset": "stanford_iprl_tri", "engine": "filterpy"},
}


class Timed(NamedTuple):
    """Speed of a tracker and what it found."""

    frames_per_s: float
    tracks: TrackTable


def time_ours(work: Workload, name: str) -> Timed:
    """Track a workload once with one of ours."""
    tracker = KalmanTracker(KalmanTracker.Config(**OURS[name]))
    steps, start = [], 0.0
    for k, objects in enumerate(work.stream):
        if k == WARM_UP:
            start = time.process_time()
        steps.append(tracker.step(objects.stamp_ns, objects))
    took = time.process_time() - start
    return Timed((len(work.stream) - WARM_UP) / took, TrackTable.of(steps))


def time_peer(work: Workload, name: str) -> Timed | None:
    """Track a workload with a peer, None where it does not run."""
    done = run_peer(name, work.stream)
    return None if done is None else Timed(done.frames_per_s, done.tracks)


def measure(count: int, repeats: int, *, quick: bool) -> list[dict[str, Any]]:
    """One row a tracker: frames a second at that many objects, and what was found."""
    rows: list[dict[str, Any]] = []
    # in a quick run the peers track few objects alone: one of them takes 3 s a frame for 420
    for name in (*OURS, *(PEERS if count <= QUICK_PEERS or not quick else ())):
        slow = name in SLOW
        frames = FEW_FRAMES[count <= 100] if slow else 30 if quick else 60
        work = workload(count, frames, moving="velocities" in name)
        ours = name in OURS
        runs = [time_ours(work, name) if ours else time_peer(work, name)]
        runs += [time_ours(work, name) for _ in range(0 if slow else repeats - 1)]
        rows.append({"objects": count, "tracker": name} | _figures(work, runs))
    reference = next(row for row in rows if row["tracker"] == "mottrack default")
    for row in rows:
        row["default is faster by"] = reference["frames/s"] / row["frames/s"]
    return rows


def _figures(work: Workload, runs: list[Timed | None]) -> dict[str, float]:
    done = [run for run in runs if run is not None]
    if not done:
        return dict.fromkeys(("frames/s", "ms a frame", "AMOTA", "MOTA", "switches"), np.nan)
    found = check(work, done[0].tracks, WARM_UP)
    best = max(run.frames_per_s for run in done) if found.holds else np.nan
    accuracy = {"AMOTA": found.amota, "MOTA": found.mota, "switches": found.switches}
    return {"frames/s": best, "ms a frame": 1e3 / best} | accuracy


def growth(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fit the growth of each tracker."""
    found = []
    for name in dict.fromkeys(row["tracker"] for row in rows):
        mine = [row for row in rows if row["tracker"] == name and row["objects"] in LADDER]
        count = np.array([row["objects"] for row in mine], float)
        took = np.array([row["ms a frame"] for row in mine])
        power = np.polyfit(np.log(count), np.log(took), 1)[0]
        found.append({"tracker": name, "growth": float(power)})
    return found


def main() -> None:
    options = arguments(__doc__ or "")
    sizes = (60, 70, 420) if options.quick else (60, 70, 300, 420, 1000)
    repeats = 2 if options.quick else 5
    time_ours(workload(60, 10, moving=True), "mottrack default, velocities")  # compiles
    rows = [row for n in sizes for row in measure(n, repeats, quick=options.quick)]
    report(rows, options.json)
    if not options.quick:
        report(growth(rows), None)


if __name__ == "__main__":
    main()

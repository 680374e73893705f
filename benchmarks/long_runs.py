"""Trackers over very many steps: do their states stay finite and their covariances positive?

A million states of the Kalman tracker in 250,000 steps, a hundred thousand steps of the fixed-lag
one, one after the other (`kalman_long_run.py` takes one bank through a million steps).
Time steps are random from 0.1 ms to 30 s with gaps of up to hours between them; every thousand
steps the scale of sizes and speeds changes over five decades and the scene moves to another place,
up to 1e7 m from the origin. Objects come with and without velocities, and are missed at times.

Printed: steps in which something was not finite, the worst asymmetry and the smallest eigenvalue of
a covariance, both of the correlation matrix, so that they have no unit, and memory.
`tests/trackers/test_long_run.py` does a small part of it.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

import numpy as np
from _common import arguments, report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from mottrack.trackers import KalmanTracker
from mottrack.trackers.fixed_lag import FixedLagTracker
from tests.trackers.long_run import Health, hostile_drive

STEPS = {"kalman": 250_000, "stanford_iprl_tri": 100_000, "fixed_lag": 100_000}
QUICK = 100
"""Of so many steps --quick does one."""


def main() -> None:
    options = arguments(__doc__ or "")
    rows = []
    for name, steps in STEPS.items():
        steps //= QUICK if options.quick else 1
        tracker = {
            "kalman": lambda: KalmanTracker(),
            "stanford_iprl_tri": lambda: KalmanTracker(
                KalmanTracker.Config(preset="stanford_iprl_tri")
            ),
            "fixed_lag": lambda: FixedLagTracker(),
        }[name]()
        health, began = Health(), time.process_time()
        for k, objects in enumerate(hostile_drive(np.random.default_rng(0), steps)):
            health.add(tracker.step(objects.stamp_ns, objects))
            if k == steps // 10:
                early_mb = memory_mb()
        rows.append(
            {
                "tracker": name,
                "steps": steps,
                "tracks": health.tracks,
                "not finite": health.not_finite,
                "asymmetry": health.asymmetry,
                "smallest eigenvalue": health.smallest,
                "MB at a tenth": early_mb,
                "MB at the end": memory_mb(),
                "us a step": 1e6 * (time.process_time() - began) / steps,
            }
        )
    report(rows, options.json)
    good = all(r["not finite"] == 0 and r["asymmetry"] < 1e-9 for r in rows)
    if not good or min(r["smallest eigenvalue"] for r in rows) <= 0.0:
        raise SystemExit(1)


def memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


if __name__ == "__main__":
    main()

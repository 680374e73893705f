"""A million steps of one bank, one after the other: does rounding ever win?

Random steps from 0.1 ms to 30 s, missed detections, scales over five decades, velocities with full
covariances. Printed: the worst asymmetry and the smallest eigenvalue met on the way, both in units
of each track's own scale. `tests/trackers/test_long_run.py` does a million steps in parallel.
"""

from __future__ import annotations

import time

import numpy as np
from _common import arguments, report

from mottrack.trackers.kalman.block_bank import BlockBank
from mottrack.trackers.kalman.observations import Matched, Observation, SeenBoxes

TRACKS = 8
CHECK_EVERY = 1000


def main() -> None:
    options = arguments(__doc__ or "")
    steps = 20_000 if options.quick else 1_000_000
    rng = np.random.default_rng(0)
    scale = 10.0 ** np.linspace(-2, 3, TRACKS)[:, None]
    process = scale**2 * 10.0 ** rng.uniform(-3, 0, (TRACKS, 11))
    bank = BlockBank(wiener=True)
    mean = np.hstack([scale * rng.normal(size=(TRACKS, 7)), np.zeros((TRACKS, 4))])
    prior = scale[:, :, None] ** 2 * np.eye(2)
    bank.append(mean, np.tile(scale**2, (1, 11)), prior)
    tilt = np.eye(2) + 0.4 * np.array([[0.0, 1.0], [1.0, 0.0]])
    asymmetry, smallest, start = 0.0, np.inf, time.process_time()
    for step in range(steps):
        bank.predict(10.0 ** rng.uniform(-4, 1.5, TRACKS), process)
        rows = np.flatnonzero(rng.random(TRACKS) < 0.7)
        noise = (scale[rows] * 10.0 ** rng.uniform(-2, 0, (len(rows), 1))) ** 2
        residual = np.sqrt(noise) * rng.normal(size=(len(rows), 7))
        box = bank.filters[0][rows, :7] + residual
        seen = SeenBoxes(box, noise[:, :, None] * tilt, np.tile(noise, (1, 5)))
        bank.update_box(Matched(rows, np.arange(len(rows))), seen)
        error = scale[rows] * rng.normal(size=(len(rows), 2))
        spread = scale[rows, :, None] ** 2 * tilt
        velocity = Observation(bank.filters[0][rows, 7:9] + error, spread)
        bank.update_velocity(rows, velocity, rng.random(len(rows)))
        if step % CHECK_EVERY == CHECK_EVERY - 1:
            covariance = bank.covariance(np.arange(TRACKS)) / scale[:, :, None] ** 2
            asymmetry = max(asymmetry, float(np.abs(covariance - covariance.mT).max()))
            smallest = min(smallest, float(np.linalg.eigvalsh(covariance).min()))
            if not np.isfinite(bank.filters[0]).all():
                raise SystemExit(f"not finite at step {step}")
    row = {
        "steps": steps,
        "tracks": TRACKS,
        "asymmetry": asymmetry,
        "smallest eigenvalue": smallest,
        "us a step": 1e6 * (time.process_time() - start) / steps,
    }
    report([row], options.json)


if __name__ == "__main__":
    main()

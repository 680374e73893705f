"""A tracker that knows the truth, for tests of what becomes of its tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.frame import Frame
from mottrack.core.result import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable


def perfect(name: str, frames: Sequence[Frame], classes: Sequence[str]) -> SceneResult:
    """Return the truth as tracks, a little beside it and with scores of their own."""
    truth = TruthTable.of(frames)
    truth = truth.select(np.isin(truth.label, classes))
    columns = {name: getattr(truth, name) for name in truth.COLUMNS}
    columns = {k: v for k, v in columns.items() if k not in ("num_points", "interpolated")}
    n = len(truth)
    noise = np.random.default_rng(3).normal(size=(n, 3))
    tracks = TrackTable(
        **columns
        | {
            "centre_m": truth.centre_m + 0.05 * noise,
            "velocity_mps": np.nan_to_num(truth.velocity_mps),
            "velocity_covariance_m2ps2": np.zeros((n, 2, 2)),
            "score": np.random.default_rng(4).uniform(size=n),
            "observed": np.ones(n, np.bool_),
            "hull_corners": np.zeros(n, np.int64),
        }
    )
    return SceneResult(
        name, FrameTable.of(frames), TruthTable.of(frames), tracks, classes=tuple(classes)
    )

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.core import Objects, VelocityMeasurement
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel

MakeObjects = Callable[..., Objects]


def rectangle(x: float, y: float, length: float, width: float) -> np.ndarray:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length / 2, width / 2]
    return corners + np.array([x, y])


@pytest.fixture
def clusters() -> MakeObjects:
    """Builds clusters from rows (x, y, length, width), with or without velocities."""

    def make(
        stamp_ns: int,
        rows: list[tuple[float, ...]],
        velocity: object = None,
        error_model: VelocityErrorModel = NO_OUTLIERS,
    ) -> Objects:
        data = np.array(rows, float).reshape(-1, 4)
        count = len(data)
        measured = None
        if velocity is not None:
            mean = np.array(velocity, float).reshape(-1, 2)
            spread = np.tile(0.04 * np.eye(2), (count, 1, 1))
            measured = VelocityMeasurement(mean, spread, np.ones(count, np.bool_), error_model)
        return Objects(
            stamp_ns=stamp_ns,
            centre_m=np.column_stack([data[:, :2], np.ones(count)]),
            size_m=np.column_stack([data[:, 2:], np.full(count, 1.5)]),
            yaw_rad=np.zeros(count),
            label=np.full(count, "generic"),
            score=np.ones(count),
            velocity=measured,
            hull=tuple(rectangle(*row) for row in data),
            position_covariance_m2=np.tile(0.01 * np.eye(2), (count, 1, 1)),
        )

    return make

"""One contract for every engine: the same numbers over a long run."""

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker

FULL = np.array([[0.3, 0.1], [0.1, 0.2]])
SPLIT = np.diag([0.3, 0.2])


def measured(objects: Objects, covariance: np.ndarray, rng: np.random.Generator) -> Objects:
    n = len(objects)
    scale = rng.uniform(0.5, 2.0, (n, 1, 1))
    velocity = VelocityMeasurement(
        rng.normal(0, 3, (n, 2)), scale * covariance, rng.random(n) < 0.7
    )
    return objects.with_velocity(velocity)


@pytest.mark.parametrize("preset", ["default", "pillarflow", "stanford_iprl_tri"])
@pytest.mark.parametrize("covariance", [FULL, SPLIT], ids=["coupled", "per axis"])
def test_engines_agree(
    workload: Callable[..., list[Objects]], preset: str, covariance: np.ndarray
) -> None:
    engines = ("block", "filterpy")
    trackers = [KalmanTracker(KalmanTracker.Config(preset=preset, engine=e)) for e in engines]
    rng = np.random.default_rng(3)
    outputs = 0
    for objects in workload(5, frames=100, crowd=20):
        objects = measured(objects, covariance, rng)
        block, other = [t.step(objects.stamp_ns, objects) for t in trackers]
        outputs += len(block)
        np.testing.assert_array_equal(block.id, other.id)
        np.testing.assert_allclose(other.state, block.state, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(other.covariance, block.covariance, rtol=1e-9, atol=1e-9)
    assert outputs > 700

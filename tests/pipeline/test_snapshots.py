import numpy as np

from mottrack.core import FlowField
from mottrack.core.grid import BevGrid
from mottrack.pipeline.snapshots import thinned


def test_thinning_keeps_what_stands_on_the_ground_before_the_ground() -> None:
    rng = np.random.default_rng(0)
    road = np.column_stack([rng.uniform(-40, 40, (20_000, 2)), np.zeros(20_000)])
    car = rng.uniform([8, -1, 0.3], [12, 1, 1.6], (400, 3))
    points = np.concatenate([road, car]).astype(np.float32)
    grid = BevGrid()
    field = FlowField.unmeasured(grid, grid.occupancy(car), 0)
    kept = thinned(points, field, 500)
    assert len(kept) == 500
    of_car = (kept[:, 2] > 0.2).sum()
    assert of_car > 100  # 2 % of the sweep, at least a fifth of what is kept
    assert np.abs(kept[kept[:, 2] < 0.2].mean(axis=0)[:2]).max() < 5  # the road, evenly
    np.testing.assert_array_equal(kept, thinned(points, field, 500))
    np.testing.assert_array_equal(thinned(points[:30], field, 500), points[:30])

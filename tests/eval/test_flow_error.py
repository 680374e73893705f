"""Flow error on cells whose error is known."""

import numpy as np
import pytest

from mottrack.core import FlowSamples
from mottrack.eval.flow_error import flow_table


def samples(estimate: list[tuple[float, float]], truth: list[tuple[float, float]]) -> FlowSamples:
    n = len(truth)
    return FlowSamples(
        frame=np.zeros(n, np.int64),
        xy_m=np.column_stack([np.arange(n) * 15.0, np.zeros(n)]).astype(np.float32),
        estimate_mps=np.array(estimate, np.float32),
        truth_mps=np.array(truth, np.float32),
        dt_s=np.full(n, 0.5, np.float32),
        valid=np.arange(n) % 2 == 0,
        dynamic=np.linalg.norm(truth, axis=1) > 0,
        movable=np.linalg.norm(truth, axis=1) > 0,
        observable=np.arange(n) < 2,
    )


def test_metres_are_speed_times_time_and_angles_are_in_space_time() -> None:
    row = flow_table([samples([(3.0, 4.0), (0.0, 0.0)], [(0.0, 0.0), (0.0, 0.0)])])["all"]
    assert row.rmse_mps == pytest.approx(5 / np.sqrt(2))
    assert row.rmse_m == pytest.approx(2.5 / np.sqrt(2))
    assert row.aae_rad == pytest.approx(np.arctan(2.5) / 2)
    assert (row.median_mps, row.within_1_mps, row.measured) == (2.5, 0.5, 0.5)


def test_rows_of_the_table_share_the_cells_out() -> None:
    data = samples([(1.0, 0.0)] * 4, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (9.0, 0.0)])
    table = flow_table([data, data])
    assert (table["dynamic"].cells, table["static"].cells, table["all"].cells) == (6, 2, 8)
    assert (table["observable all"].cells, table["observable dynamic"].cells) == (4, 2)
    assert table["measured all"].measured == 1.0
    for unit in ("speed", "range"):
        assert sum(row.cells for name, row in table.items() if name.startswith(unit)) == 8
    assert table["speed [8, inf) m/s"].rmse_mps == 8.0
    assert np.isnan(table["speed [3, 8) m/s"].rmse_mps)


def test_right_flow_has_no_error() -> None:
    row = flow_table([samples([(1.5, -2.0), (0.0, 7.0)], [(1.5, -2.0), (0.0, 7.0)])])["all"]
    assert (row.rmse_m, row.rmse_mps, row.within_1_mps) == (0.0, 0.0, 1.0)
    assert row.aae_rad == pytest.approx(0.0, abs=1e-9)

"""What the rounding of a processor's matrix product can change (docs/metrics.md)."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.eval.nuscenes.products import product

WAYS = range(3)
ROUNDING = 2.0**-53
"""Half a unit in the last place of 1."""
Place = st.tuples(st.floats(-2500.0, 2500.0), st.floats(-2500.0, 2500.0))
Step = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@settings(deadline=None)  # the first call compiles
@given(Place, Step)
def test_the_ways_differ_by_no_more_than_the_stated_bound(
    place: tuple[float, float], step: tuple[float, float]
) -> None:
    (x, y), (a, b) = place, (place[0] + step[0], place[1] + step[1])
    own, other = x * x + y * y, a * a + b * b
    squares = [(-2.0 * product(way, x, y, a, b) + own) + other for way in WAYS]
    reach = max(own, other)
    spread = max(squares) - min(squares)
    assert spread <= 10.0 * ROUNDING * reach
    distances = np.sqrt(np.maximum(squares, 0.0))
    assert np.ptp(distances) <= np.sqrt(10.0 * ROUNDING * reach)

"""Sums, quantiles and tails of pieces against numpy's of one array."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.eval.streams import Distribution, Largest, RunningSum, Wanted

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.95, 0.99, 1.0)


def pieces(rng: np.random.Generator, values: np.ndarray, most: int) -> list[np.ndarray]:
    """The values cut at random places; some pieces are empty."""
    return np.split(values, np.sort(rng.integers(0, len(values) + 1, most)))


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(0, 3000), digits=st.integers(0, 3))
def test_pieces_give_what_one_array_gives_to_the_last_bit(
    seed: int, size: int, digits: int
) -> None:
    rng = np.random.default_rng(seed)
    values = np.abs(rng.normal(size=size)) * 10.0 ** rng.integers(-6, 6, size)
    if digits:  # equal values, zeros among them
        values = np.round(values, digits - 1)
    cut = pieces(rng, values, int(rng.integers(1, 12)))
    total = RunningSum(size)
    found = Distribution(Wanted(QUANTILES, largest_share=0.05))
    for part in cut:
        found.count(part)
    for part in cut:
        total.add(part)
        found.add(part)
    assert total.total == np.sum(values)
    if not size:
        assert np.isnan([found.mean, found.median, found.quantile(0.5)]).all()
        return
    assert found.mean == np.mean(values)
    assert found.median == np.median(values)
    assert [found.quantile(q) for q in QUANTILES] == np.quantile(values, QUANTILES).tolist()
    tail = max(1, round(0.05 * size))
    assert found.mean_of_largest == np.sort(values)[-tail:].mean()


def test_more_values_than_are_held(monkeypatch: object) -> None:
    from mottrack.eval import streams

    monkeypatch.setattr(streams, "_HELD", 100)  # type: ignore[attr-defined]
    rng = np.random.default_rng(3)
    values = rng.gamma(1.0, size=20_000)
    found, largest = Distribution(Wanted((0.5, 0.95))), Largest(500)
    cut = pieces(rng, values, 40)
    for part in cut:
        found.count(part)
    for scene, part in enumerate(cut):
        found.add(part)
        largest.add(part, scene)
    assert found.median == np.median(values)
    assert found.quantile(0.95) == np.quantile(values, 0.95)
    error, scene = largest.ascending()
    order = np.argsort(values, kind="stable")[-500:]
    np.testing.assert_array_equal(error, values[order])
    np.testing.assert_array_equal(
        scene, np.repeat(np.arange(len(cut)), [len(p) for p in cut])[order]
    )

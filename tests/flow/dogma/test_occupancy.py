"""Evidence on {occupied, free}, compared with Dempster's rule over the power set."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.flow.dogma.occupancy import (
    CellPrior,
    OccupancyConfig,
    Rates,
    combine,
    predict_cell,
    split_cell,
)

SHARE = st.floats(0, 0.999)


@st.composite
def masses(draw):
    """Occupied and free mass that leave something unknown."""
    occupied = draw(SHARE)
    return occupied, draw(SHARE) * (1 - occupied)


def dempster(a, b):
    """The rule over subsets of {O, F}, straight from its definition."""
    total = dict.fromkeys(("O", "F", "OF"), 0.0)
    sides = [{"O": m[0], "F": m[1], "OF": 1 - m[0] - m[1]} for m in (a, b)]
    for (name_a, mass_a), (name_b, mass_b) in product(*(side.items() for side in sides)):
        common = "".join(sorted(set(name_a) & set(name_b), reverse=True))
        if common:
            total[common] += mass_a * mass_b
    agreed = sum(total.values())
    return total["O"] / agreed, total["F"] / agreed


@given(masses(), masses())
@settings(deadline=None)
def test_the_update_is_dempsters_rule(a, b):
    expected = dempster(a, b)
    np.testing.assert_allclose(combine(CellPrior(*a, 0.0), b), expected, atol=1e-9)
    np.testing.assert_allclose(combine(CellPrior(*b, 0.0), a), expected, atol=1e-9)


@given(masses())
@settings(deadline=None)
def test_no_evidence_changes_nothing(a):
    np.testing.assert_allclose(combine(CellPrior(*a, 0.0), (0.0, 0.0)), a, atol=1e-12)


@settings(deadline=None)
@given(st.floats(0, 5), masses(), st.floats(0.01, 1), st.floats(0.001, 2))
def test_predicted_and_split_masses_add_up(carried, before, birth, dt_s):
    rates = Rates.over(dt_s, OccupancyConfig(birth=birth))
    occupied, free, unseen = prior = predict_cell(carried, before, rates)
    assert occupied == min(carried, 1)
    assert 0 <= free <= before[1]
    assert unseen >= 0
    assert occupied + free + unseen <= 1 + 1e-12
    persistent, born, uncovered = split_cell(prior, 0.8, rates)
    assert persistent >= -1e-12
    assert born >= 0
    assert 0 <= uncovered <= 1
    np.testing.assert_allclose(persistent + born, 0.8)


def test_one_birth_probability_is_the_papers_formula():
    rates = Rates.over(0.1, OccupancyConfig(birth=0.02, birth_unseen=0.02))
    _, born, _ = split_cell(CellPrior(0.3, 0.2, 0.4), 0.9, rates)
    np.testing.assert_allclose(born, 0.9 * 0.02 * 0.7 / (0.3 + 0.02 * 0.7))


def test_what_comes_into_view_is_born_and_what_enters_free_space_is_not():
    rates = Rates.over(0.1, OccupancyConfig())
    _, born_unseen, _ = split_cell(CellPrior(0.02, 0.0, 0.98), 0.9, rates)
    _, born_free, _ = split_cell(CellPrior(0.02, 0.95, 0.0), 0.9, rates)
    assert born_unseen > 2 * born_free

"""CLEAR, identity and HOTA: hand-made sequences and the laws they obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core.errors import InputError
from mottrack.eval import clear, hota, identity
from mottrack.eval.pairs import BoxStream, Pairs, centre_distance, find_pairs

Rows = list[tuple[int, int, float]]
"""Frame, identity, position along x."""


def pairs_of(truth: Rows, tracks: Rows, frames: int) -> Pairs:
    sides = []
    for rows in (truth, tracks):
        values = np.array(sorted(rows), np.float64).reshape(-1, 3)
        side = BoxStream(values[:, 0].astype(np.int64), values[:, 1].astype(np.int64))
        sides.append((side, np.column_stack([values[:, 2], np.zeros(len(values))])))
    measure = centre_distance(sides[0][1], sides[1][1], 2.0)
    return find_pairs(sides[0][0], sides[1][0], frames, measure)


def clear_of(pairs: Pairs) -> clear.ClearCounts:
    return clear.clear_counts(pairs, clear.associate(pairs))


def test_counts_of_a_sequence_worked_out_by_hand() -> None:
    truth = [(f, 1, 0.0) for f in range(8)] + [(f, 2, 10.0) for f in range(8)]
    # object 1: 7 with a gap in 2, then 8 from 5 on; object 2 never; one box in the open
    tracks = [(f, 7, 0.5) for f in (0, 1, 3, 4)] + [(f, 8, 0.5) for f in (5, 6, 7)] + [(0, 9, 30.0)]
    counts = clear_of(pairs_of(truth, tracks, 8))
    assert (counts.truth, counts.matches, counts.switches, counts.misses) == (16, 6, 1, 9)
    assert (counts.false_positives, counts.fragmentations) == (1, 1)
    assert (counts.mostly_tracked, counts.mostly_lost, counts.truth_tracks) == (1, 1, 2)
    assert counts.mota == pytest.approx(1 - 11 / 16)
    assert counts.motp == pytest.approx(0.5)
    ids = identity.identity_counts(pairs_of(truth, tracks, 8))
    assert (ids.true_positives, ids.truth, ids.tracked) == (4, 16, 8)
    assert ids.idf1 == pytest.approx(8 / 24)


def test_a_match_lasts_although_another_box_comes_nearer() -> None:
    truth = [(f, 1, 0.0) for f in range(3)]
    tracks = [(0, 5, 1.5), (1, 5, 1.5), (1, 6, 0.0), (2, 5, 1.5), (2, 6, 0.0)]
    counts = clear_of(pairs_of(truth, tracks, 3))
    assert (counts.switches, counts.matches, counts.false_positives) == (0, 3, 2)


def test_more_matches_go_before_less_distance() -> None:
    # the nearest pair would leave object 2 without a partner
    pairs = pairs_of([(0, 1, 0.0), (0, 2, 1.5)], [(0, 5, 0.1), (0, 6, -1.5)], 1)
    assert clear_of(pairs).matches == 2


rows = st.lists(
    st.tuples(st.integers(0, 5), st.integers(0, 3), st.floats(-4, 4)),
    unique_by=lambda row: row[:2],
    min_size=1,
    max_size=20,
)


@settings(max_examples=60, deadline=None)
@given(rows, rows)
def test_laws(truth: Rows, tracks: Rows) -> None:
    pairs = pairs_of(truth, tracks, 6)
    counts = clear_of(pairs)
    assert counts.matches + counts.switches + counts.misses == len(truth)
    assert counts.matches + counts.switches + counts.false_positives == len(tracks)
    renamed = clear_of(pairs_of(truth, [(f, 50 + 3 * i, x) for f, i, x in tracks], 6))
    assert renamed == counts
    figures = hota.hota(hota.hota_counts(pairs)).as_dict()
    assert all(0.0 <= value <= 1.0 + 1e-12 for value in figures.values())
    twice = clear.total([counts, counts])
    assert twice.mota == pytest.approx(counts.mota)
    together = hota.hota(hota.total([hota.hota_counts(pairs)] * 2)).as_dict()
    assert together == pytest.approx(figures)


@settings(max_examples=30, deadline=None)
@given(rows)
def test_truth_itself_is_perfect(truth: Rows) -> None:
    pairs = pairs_of(truth, truth, 6)
    ids = identity.identity_counts(pairs)
    assert ids.idf1 == 1.0
    assert hota.hota(hota.hota_counts(pairs)).hota == pytest.approx(1.0)


def test_nothing_at_all_and_rows_out_of_order() -> None:
    empty = pairs_of([], [], 3)
    assert np.isnan(clear_of(empty).mota)
    assert hota.hota(hota.hota_counts(empty)).as_dict()["hota"] == 0.0
    assert clear_of(pairs_of([(0, 1, 0.0)], [], 1)).misses == 1
    with pytest.raises(InputError, match="sorted by frame"):
        BoxStream(np.array([1, 0]), np.array([0, 0]))


@pytest.mark.parametrize("seed", range(10))
def test_a_crowd_scores_as_the_whole_matrix_does(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Strips, and groups of boxes that share a pair, give the pairs and counts of the matrix."""
    rng = np.random.default_rng(seed)
    rows = [(f, i, float(x)) for f in range(4) for i, x in enumerate(rng.uniform(0, 60, 150))]
    shifted = [(f, (i + f) % 150, x + float(rng.normal(0, 0.4))) for f, i, x in rows]
    plain = pairs_of(rows, shifted, 4)
    counts = clear_of(plain), identity.identity_counts(plain), hota.hota_counts(plain)
    for module in ("pairs", "assignment", "clear"):
        monkeypatch.setattr(f"mottrack.eval.{module}.DENSE", 0)
    crowd = pairs_of(rows, shifted, 4)
    for name in ("truth_row", "track_row", "distance", "similarity"):
        np.testing.assert_array_equal(getattr(crowd, name), getattr(plain, name))
    again = clear_of(crowd)
    assert again.distance == pytest.approx(counts[0].distance)
    assert again.matches == counts[0].matches
    assert again.switches == counts[0].switches
    assert identity.identity_counts(crowd) == counts[1]
    for name, value in zip(
        hota.HotaCounts.__dataclass_fields__, vars_of(hota.hota_counts(crowd)), strict=True
    ):
        np.testing.assert_allclose(value, getattr(counts[2], name), err_msg=name)


def vars_of(counts: hota.HotaCounts) -> list[np.ndarray]:
    return [getattr(counts, name) for name in hota.HotaCounts.__dataclass_fields__]

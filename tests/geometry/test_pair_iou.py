"""Listed pairs against all pairs."""

import numpy as np

from mottrack.geometry.iou import bev_iou
from mottrack.geometry.pair_iou import bev_iou_of_pairs


def test_pairs_agree_with_all_pairs() -> None:
    rng = np.random.default_rng(0)
    a, b = (
        np.column_stack(
            [
                rng.uniform(600, 608, (30, 2)),
                np.zeros(30),
                rng.uniform(0.5, 5, (30, 3)),
                rng.uniform(-4, 4, 30),
            ]
        )
        for _ in range(2)
    )
    i, j = (index.ravel() for index in np.indices((30, 30)))
    np.testing.assert_allclose(
        bev_iou_of_pairs(a, b, (i, j)).reshape(30, 30), bev_iou(a, b), atol=1e-12
    )
    assert len(bev_iou_of_pairs(a, b, (i[:0], j[:0]))) == 0

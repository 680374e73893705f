"""Dynamic pillars equal the padded (D, P, N) form of the paper, for training and inference."""

from __future__ import annotations

import numpy as np
import torch

from mottrack.flow.pillarflow.engine import fold_linear
from mottrack.flow.pillarflow.network import BinaryEncoder, PillarEncoder, PointBatch
from mottrack.flow.pillarflow.pillars import CellGrid, binary_image, describe, pillar_image

GRID = CellGrid(-8.0, -4.0, 0.5, 16, 32)


def _points(count: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(3)
    xyzr = rng.uniform((-9, -5, 0, 0), (9, 5, 2.5, 1), (count, 4))
    return xyzr.astype(np.float32)


def _batch(points: np.ndarray) -> PointBatch:
    described = describe(points, GRID)
    tensors = (torch.from_numpy(one) for one in (described.descriptors, described.cells))
    return PointBatch(*tensors, 1, GRID.rows, GRID.columns)


def _encoder(channels: int = 24) -> PillarEncoder:
    """An encoder whose normalisation has statistics worth folding."""
    torch.manual_seed(1)
    encoder = PillarEncoder(channels)
    described = torch.from_numpy(describe(_points(), GRID).descriptors)
    for _ in range(3):
        encoder.norm(encoder.linear(described))
    torch.nn.init.uniform_(encoder.norm.weight, 0.5, 1.5)
    torch.nn.init.uniform_(encoder.norm.bias, -0.5, 0.5)
    return encoder.eval()


def _padded(points: np.ndarray, encoder: PillarEncoder) -> np.ndarray:
    """Section III-A as written, in float64: (D,P,N) tensor, masked maximum, scatter."""
    xy = np.floor((points[:, :2].astype(np.float64) - (GRID.x_min_m, GRID.y_min_m)) / GRID.cell_m)
    inside = ((xy >= 0) & (xy < (GRID.columns, GRID.rows))).all(axis=1)
    points, xy = points[inside].astype(np.float64), xy[inside].astype(int)
    pillars, pillar, counts = np.unique(xy, axis=0, return_inverse=True, return_counts=True)
    pillar = pillar.ravel()
    padded = np.zeros((9, len(pillars), counts.max()))
    filled = np.zeros((len(pillars), counts.max()), bool)
    slots = np.zeros(len(pillars), int)
    for point, p in zip(points, pillar, strict=True):
        mean = points[pillar == p, :3].mean(axis=0)
        centre = (pillars[p] + 0.5) * GRID.cell_m + (GRID.x_min_m, GRID.y_min_m)
        offsets = np.concatenate((point[:3] - mean, point[:2] - centre)) / GRID.cell_m
        whole = np.concatenate((point[:2] * 0.02, [point[2] * 0.5, point[3]], offsets))
        padded[:, p, slots[p]], filled[p, slots[p]] = whole, True
        slots[p] += 1
    weight, bias = (part.double().numpy() for part in fold_linear(encoder))
    embedded = np.einsum("cd,dpn->cpn", weight, padded) + bias[:, None, None]
    compressed = np.where(filled, np.maximum(embedded, 0.0), 0.0).max(axis=2)
    image = np.zeros((GRID.rows, GRID.columns, len(bias)))
    image[pillars[:, 1], pillars[:, 0]] = compressed.T
    return image


def test_dynamic_pillars_equal_the_padded_form() -> None:
    points, encoder = _points(), _encoder()
    expected = _padded(points, encoder)
    weight, bias = (part.numpy() for part in fold_linear(encoder))
    fused = pillar_image(points, GRID, weight, bias)
    with torch.no_grad():
        trained = encoder(_batch(points))[0].permute(1, 2, 0).numpy()
    scale = np.abs(expected).max()
    assert np.abs(fused - expected).max() < 1e-6 * scale
    assert np.abs(trained - expected).max() < 1e-6 * scale
    assert (expected > 0).any()


def test_binary_image_is_the_occupancy() -> None:
    points = _points(50)
    expected = np.zeros(GRID.cells)
    expected[describe(points, GRID).cells] = 1.0
    assert np.array_equal(binary_image(points, GRID).ravel(), expected)
    assert np.array_equal(BinaryEncoder()(_batch(points)).numpy().ravel(), expected)


def test_no_point_gives_an_empty_image() -> None:
    weight, bias = (part.numpy() for part in fold_linear(_encoder()))
    assert not pillar_image(np.zeros((0, 4), np.float32), GRID, weight, bias).any()

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mottrack.world.catalogue import KINDS, TRACKED
from mottrack.world.config import DetectorConfig
from mottrack.world.detector import FrameDraws, Visible, detect, recall


def crowd(rng, count: int, *, far: bool = False) -> Visible:
    """Well separated objects on a lattice, so that a detection belongs to one of them."""
    side = int(np.ceil(np.sqrt(count)))
    lattice = np.stack(np.meshgrid(*[np.arange(side) - side / 2] * 2), -1).reshape(-1, 2)[:count]
    xy = lattice * 9.0 + (400.0 if far else 0.0)
    label = rng.choice(np.array(TRACKED), count)
    size = np.array([KINDS[name].mean_size for name in label]).reshape(count, 3)
    away = np.hypot(*xy.T)
    points = rng.poisson(3000.0 * size[:, 0] / np.maximum(away, 5.0) ** 2)
    centre = np.column_stack([xy, 0.5 * size[:, 2]])
    return Visible(centre, size, rng.uniform(-3, 3, count), label, np.arange(count), points)


def test_scores_are_the_share_of_true_detections():
    rng, config = np.random.default_rng(0), DetectorConfig(max_range_m=90.0)
    scores, true = [], []
    for frame in range(250):
        visible, imagined = crowd(rng, 60), crowd(rng, 40, far=True)
        rates = rng.beta(0.8, 2.5, 40)
        found = detect(visible, imagined, rates, config, FrameDraws(7, frame * 500_000_000))
        scores.append(found.score)
        true.append(found.centre_m[:, 0] < 200.0)
    score, hit = np.concatenate(scores), np.concatenate(true)
    edges = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.01])
    for low, high in pairwise(edges):
        inside = (score >= low) & (score < high)
        if inside.sum() < 100:
            continue
        error = 3.5 * np.sqrt(0.25 / inside.sum()) + 0.01
        assert abs(hit[inside].mean() - score[inside].mean()) < error


def test_recall_falls_with_range_and_with_few_returns():
    n = 5
    base = {
        "size_m": np.ones((n, 3)), "yaw_rad": np.zeros(n),
        "label": np.full(n, "car"), "id": np.arange(n),
    }  # fmt: skip
    far = np.column_stack([np.array([5.0, 20.0, 40.0, 60.0, 70.0]), np.zeros(n), np.zeros(n)])
    by_range = recall(Visible(centre_m=far, num_points=np.full(n, 50), **base), DetectorConfig())
    assert (np.diff(by_range) <= 0).all()
    assert by_range[0] > 0.9
    assert by_range[-1] == 0.0
    points = np.array([0, 1, 3, 10, 100])
    by_points = recall(
        Visible(centre_m=np.zeros((n, 3)), num_points=points, **base), DetectorConfig()
    )
    assert (np.diff(by_points) > 0).all()
    assert by_points[0] == 0.0


def test_found_share_equals_recall_though_misses_are_correlated():
    rng, config = np.random.default_rng(1), DetectorConfig()
    visible, none = crowd(rng, 50), crowd(rng, 0)
    expected = recall(visible, config)
    names, again = [], []
    before = np.zeros(50, dtype=bool)
    for frame in range(400):
        draws = FrameDraws(3, frame * 100_000_000)
        found = draws.uniforms(visible.id, 10) < expected
        names.append(found)
        again.append((found == before).mean())
        before = found
    share = np.mean(names, axis=0)
    assert np.allclose(share, expected, atol=0.16)
    assert np.mean(share - expected) == pytest.approx(0.0, abs=0.02)
    independent = np.mean(expected**2 + (1 - expected) ** 2)
    assert np.mean(again) > independent + 0.01
    assert len(detect(visible, none, np.zeros(0), config, FrameDraws(3, 0))) > 20


def test_noise_is_small_near_and_headings_flip_at_the_stated_share():
    rng, config = np.random.default_rng(2), DetectorConfig(flips=0.1, max_range_m=90.0)
    offsets, flipped = [], []
    for frame in range(120):
        visible = crowd(rng, 40)
        found = detect(
            visible, crowd(rng, 0), np.zeros(0), config, FrameDraws(9, frame * 500_000_000)
        )
        gap = np.linalg.norm(found.centre_m[:, None, :2] - visible.centre_m[None, :, :2], axis=2)
        match = gap.argmin(axis=1)
        offsets.append(gap.min(axis=1))
        error = np.angle(np.exp(1j * (found.yaw_rad - visible.yaw_rad[match])))
        vehicle = visible.label[match] != "pedestrian"
        flipped.append(np.abs(error[vehicle]) > np.pi / 2)
    assert 0.05 < np.median(np.concatenate(offsets)) < 0.35
    assert np.concatenate(flipped).mean() == pytest.approx(0.1, abs=0.025)


def test_a_scene_has_plausible_detections(scenes):
    found = missed = false = 0
    for scene in scenes:
        for index in range(0, 40, 5):
            frame = scene.frame(index)
            truth = frame.truth.select(np.isin(frame.truth.label, TRACKED))
            clear = truth.select(truth.num_points > 20)
            gap = np.linalg.norm(
                frame.detections.centre_m[:, None, :2] - truth.centre_m[None, :, :2], axis=2
            )
            near = np.linalg.norm(
                clear.centre_m[:, None, :2] - frame.detections.centre_m[None, :, :2], axis=2
            ).min(axis=1)
            found, missed = found + int((near < 2).sum()), missed + int((near >= 2).sum())
            false += int((gap.min(axis=1) > 2.0).sum())
    assert found / (found + missed) > 0.8
    assert 1 < false / 24 < 40

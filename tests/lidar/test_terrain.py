from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.core import InputError, Pose, Sweep
from mottrack.lidar.terrain import Terrain

Surface = Callable[[np.ndarray], np.ndarray]


def sweep_over(
    surface: Surface, pose: Pose, extra: np.ndarray | None = None, hidden: object = None
) -> Sweep:
    """Ground points within 40 m of the vehicle, plus other world points; `hidden` drops ground."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-40, 40, (30_000, 2)) + pose.translation_m[:2]
    if hidden is not None:
        xy = xy[~hidden(xy)]
    world = np.column_stack([xy, surface(xy) + 0.02 * rng.normal(size=len(xy))])
    if extra is not None:
        world = np.concatenate([world, extra])
    local = pose.inverse().apply(world).astype(np.float32)
    return Sweep(local, np.zeros(len(local), np.float32), 10**9, pose)


def flat(xy: np.ndarray) -> np.ndarray:
    return np.zeros(len(xy))


def hill(xy: np.ndarray) -> np.ndarray:
    return 0.12 * xy[:, 0] + 1.5 * np.sin(xy[:, 1] / 15)


def blob(x: float, y: float, reach: float, low: float, high: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    xy = rng.uniform(-reach, reach, (4000, 2)) + np.array([x, y])
    return np.column_stack([xy, rng.uniform(low, high, len(xy))])


def heights(terrain: Terrain, xy_m: np.ndarray, level_m: float = 0.0) -> np.ndarray:
    """Height of the ground at world positions (N, 2), by points at a known level over them."""
    pose = Pose(np.eye(3), np.array([*xy_m.mean(axis=0), level_m]))
    local = np.column_stack([xy_m - pose.translation_m[:2], np.zeros(len(xy_m))])
    probe = Sweep(local.astype(np.float32), np.zeros(len(xy_m), np.float32), 1, pose)
    return level_m - terrain.height_above_m(probe)


PROBE = np.random.default_rng(3).uniform(-30, 30, (500, 2))


@pytest.mark.parametrize("origin_m", [0.0, 0.4, 2.0])
@pytest.mark.parametrize("surface", [flat, hill])
def test_heights_on_flat_and_sloping_ground(surface: Surface, origin_m: float) -> None:
    terrain = Terrain()
    turn = Pose.from_yaw(0.7, (3.0, -2.0, origin_m))
    terrain.update(sweep_over(surface, turn))
    error = heights(terrain, PROBE) - surface(PROBE)
    assert np.abs(error).max() < 0.25
    assert np.percentile(np.abs(error), 95) < 0.1


def test_a_crown_and_a_bridge_are_not_ground() -> None:
    over = np.concatenate([blob(10, 5, 4, 2.5, 6), blob(-10, 0, 5, 4.5, 5)])
    terrain = Terrain()
    terrain.update(sweep_over(flat, Pose.identity(), over))
    assert np.abs(heights(terrain, PROBE)).max() < 0.1


def test_a_lorry_that_covers_the_road_is_not_ground() -> None:
    lorry = blob(10, 0, 1.25, 0.4, 3.5)
    covered = lambda xy: (np.abs(xy - [10, 0]) < 1.6).all(axis=1)  # noqa: E731
    terrain = Terrain()
    terrain.update(sweep_over(flat, Pose.identity(), lorry, covered))
    assert abs(heights(terrain, np.array([[10.0, 0.0]]))[0]) < 0.12


def test_ground_seen_before_is_remembered_when_something_covers_it() -> None:
    wide = lambda xy: (np.abs(xy - [10, 0]) < 6).all(axis=1)  # noqa: E731
    roof = blob(10, 0, 6, 2.8, 3.0)
    hidden = sweep_over(hill, Pose.identity(), roof, wide)
    first = Terrain()
    first.update(sweep_over(hill, Pose.identity()))
    before = heights(first, PROBE)
    first.update(hidden)
    spot = np.array([[10.0, 0.0]])
    assert abs(heights(first, spot)[0] - hill(spot)[0]) < 0.1
    assert np.abs(heights(first, PROBE) - before).max() < 0.2


def test_returns_from_below_the_road_are_ignored() -> None:
    pits = np.array([[x, 0.0, -2.0] for x in range(-20, 20, 5) for _ in range(3)])
    terrain = Terrain()
    terrain.update(sweep_over(flat, Pose.identity(), pits))
    assert np.abs(heights(terrain, PROBE)).max() < 0.15


def test_the_map_moves_with_the_vehicle_far_from_the_origin() -> None:
    terrain = Terrain()
    for k in range(8):
        pose = Pose.from_yaw(0.1 * k, (4e5 + 9.7 * k, -3e5, 100.0))
        terrain.update(sweep_over(lambda xy: 100.0 + 0.05 * (xy[:, 0] - 4e5), pose))
    probe = PROBE + pose.translation_m[:2]
    error = heights(terrain, probe, 100.0) - (100.0 + 0.05 * (probe[:, 0] - 4e5))
    assert np.abs(error).max() < 0.15


def test_nothing_is_known_before_the_first_sweep_or_after_a_reset() -> None:
    terrain = Terrain()
    with pytest.raises(InputError, match="sweeps seen"):
        heights(terrain, PROBE)
    terrain.update(sweep_over(flat, Pose.identity()))
    terrain.reset()
    with pytest.raises(InputError, match="sweeps seen"):
        heights(terrain, PROBE)
    empty = Sweep(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), 1, Pose.identity())
    terrain.update(empty)
    assert np.isfinite(heights(terrain, PROBE)).all()

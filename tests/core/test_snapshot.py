from pathlib import Path

import numpy as np
import pytest

from mottrack.core import FlowField, Objects, ResultError, VelocityMeasurement
from mottrack.core.grid import BevGrid
from mottrack.core.snapshot import Snapshot, load_snapshots, save_snapshots

GRID = BevGrid(-10, 10, -5, 5, 0.5)


def snapshot(frame: int, rng: np.random.Generator) -> Snapshot:
    field = FlowField.unmeasured(GRID, rng.random(GRID.shape) < 0.1, frame)
    velocity = VelocityMeasurement(
        np.array([[1.234, -5.0], [0.0, 0.0]]),
        np.tile(np.eye(2), (2, 1, 1)),
        np.array([True, False]),
    )
    objects = Objects(
        stamp_ns=frame,
        centre_m=rng.normal((4e6, -9e5, 1.0), size=(2, 3)),
        size_m=np.array([[4.5, 1.9, 1.6], [0.7, 0.6, 1.7]]),
        yaw_rad=np.array([0.5, -3.0]),
        label=np.array(["car", "pedestrian"]),
        score=np.array([0.9, 0.2]),
        velocity=velocity,
    )
    points = rng.uniform(-80, 80, (300 + frame, 3)).astype(np.float32)
    return Snapshot.of(frame, points, field, objects)


def test_what_is_stored_comes_back_to_the_centimetre(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    written = [snapshot(k, rng) for k in range(3)] + [
        Snapshot.of(3, np.zeros((0, 3), np.float32), None, None)
    ]
    save_snapshots(tmp_path / "a.npz", written)
    read = load_snapshots(tmp_path / "a.npz")
    assert [s.frame for s in read] == [0, 1, 2, 3]
    for before, after in zip(written, read, strict=True):
        np.testing.assert_allclose(after.xyz_m, before.xyz_m, atol=0.0051)
        np.testing.assert_array_equal(after.cells, before.cells)
        np.testing.assert_allclose(after.velocity_mps, before.velocity_mps, atol=0.0051)
        assert after.grid == before.grid
        assert after.objects.label.tolist() == before.objects.label.tolist()
        np.testing.assert_allclose(after.objects.centre_m, before.objects.centre_m, atol=1e-3)
        np.testing.assert_allclose(after.objects.velocity_mps, before.objects.velocity_mps)
    np.testing.assert_allclose(read[0].objects.velocity_mps[0], [1.234, -5.0])
    assert np.isnan(read[0].objects.velocity_mps[1]).all()


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_snapshots(path, [snapshot(0, np.random.default_rng(1))])
    data = bytearray(path.read_bytes())
    data[100] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(ResultError, match="checksum"):
        load_snapshots(path)

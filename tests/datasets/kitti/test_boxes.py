"""Camera boxes to the ego frame and back are exact, and face the way KITTI says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mottrack.core import Pose
from mottrack.datasets.kitti.boxes import CameraBoxes, EgoBoxes, camera_to_ego, ego_to_camera

# KITTI's nominal mounting: camera x right, y down, z forward; ego x forward, y left, z up.
NOMINAL = Pose(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.27, 0.0, -0.08]))


@given(
    st.lists(st.floats(-100, 100), min_size=3, max_size=3),
    st.lists(st.floats(0.1, 20), min_size=3, max_size=3),
    st.floats(-np.pi, np.pi, exclude_max=True),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4),
)
def test_round_trip_is_exact(bottom, size, ry, quaternion):
    q = np.array(quaternion) + np.array([1.5, 0, 0, 0])
    mounting = Pose.from_quaternion_wxyz(q / np.linalg.norm(q), [0.3, -0.1, 0.2]) @ NOMINAL
    camera = CameraBoxes(np.array([bottom]), np.array([size]), np.array([ry]))
    back = ego_to_camera(camera_to_ego(camera, mounting), mounting)
    assert np.abs(back.bottom_m - camera.bottom_m).max() < 1e-9
    np.testing.assert_array_equal(back.size_hwl_m, camera.size_hwl_m)
    assert abs((back.ry_rad[0] - ry + np.pi) % (2 * np.pi) - np.pi) < 1e-9


@pytest.mark.parametrize(
    ("ry_rad", "heading"),
    [(-np.pi / 2, [1, 0]), (0.0, [0, -1]), (np.pi / 2, [-1, 0]), (np.pi - 1e-12, [0, 1])],
)
def test_heading_convention(ry_rad, heading):
    # ry = 0 faces along the camera's x, which is to the right: ego -y
    camera = CameraBoxes(np.zeros((1, 3)), np.array([[1.5, 1.8, 4.0]]), np.array([ry_rad]))
    yaw = camera_to_ego(camera, NOMINAL).yaw_rad[0]
    np.testing.assert_allclose([np.cos(yaw), np.sin(yaw)], heading, atol=1e-9)


def test_bottom_and_size_order():
    camera = CameraBoxes(np.array([[1.0, 1.65, 10.0]]), np.array([[1.5, 1.8, 4.0]]), np.zeros(1))
    ego = camera_to_ego(camera, NOMINAL)
    np.testing.assert_allclose(ego.size_m, [[4.0, 1.8, 1.5]])
    np.testing.assert_allclose(ego.centre_m, [[10.27, -1.0, -0.98]])
    assert isinstance(ego, EgoBoxes)

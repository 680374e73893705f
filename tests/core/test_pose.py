import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mottrack.core import InputError, Pose

angles = st.floats(-3.1, 3.1)
metres = st.floats(-1e4, 1e4)


def random_pose(seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    return Pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3) * 100)


@given(st.integers(0, 1000))
def test_inverse_undoes_and_composition_associates(seed: int) -> None:
    a_T_b, b_T_c = random_pose(seed), random_pose(seed + 1)
    points = np.random.default_rng(seed).normal(size=(5, 3)) * 50
    np.testing.assert_allclose(a_T_b.inverse().apply(a_T_b.apply(points)), points, atol=1e-9)
    np.testing.assert_allclose((a_T_b @ b_T_c).apply(points), a_T_b.apply(b_T_c.apply(points)))
    assert a_T_b.inverse().yaw_rad == pytest.approx(-a_T_b.yaw_rad, abs=1e-12)


@given(angles, metres)
def test_quaternion_agrees_with_scipy(yaw_rad: float, x_m: float) -> None:
    x, y, z, w = Rotation.from_euler("xyz", [0.1, -0.2, yaw_rad]).as_quat()
    pose = Pose.from_quaternion_wxyz([w, x, y, z], [x_m, 0, 0])
    np.testing.assert_allclose(
        pose.rotation, Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-12
    )


def test_a_long_chain_of_turns_stays_a_rotation() -> None:
    step, pose = Pose.from_yaw(1e-3, (0.01, 0, 0)), Pose.identity()
    for _ in range(20_000):
        pose = pose @ step
    assert np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() < 1e-12


def test_a_transposed_matrix_is_refused_instead_of_losing_its_translation() -> None:
    matrix = Pose.from_yaw(0.3, (5.0, 6.0, 0.0)).matrix
    assert Pose.from_matrix(matrix[:3]).translation_m.tolist() == [5.0, 6.0, 0.0]
    with pytest.raises(InputError, match=r"last row of matrix is \[5.0, 6.0, 0.0, 1.0\]"):
        Pose.from_matrix(matrix.T)


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        (np.eye(3) * 2, np.zeros(3), "orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), "right-handed"),
        (np.eye(3), [np.nan, 0, 0], "translation_m"),
        (np.eye(4), np.zeros(3), "shape of rotation"),
    ],
)
def test_an_invalid_pose_is_refused(rotation: object, translation: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Pose(rotation, translation)  # type: ignore[arg-type]

"""Velocities of labelled tracks."""

import numpy as np

from mottrack.core.label_velocities import centred_velocities


def test_centred_inside_one_sided_at_the_ends_unknown_alone():
    ids = np.array([5, 9, 5, 5])
    stamps = np.array([0, 0, 1_000_000_000, 500_000_000])
    xy = np.array([[0.0, 0.0], [7.0, 7.0], [4.0, 0.0], [1.0, 0.0]])
    velocity = centred_velocities(ids, stamps, xy)
    np.testing.assert_allclose(velocity[[0, 3, 2]], [[2, 0], [4, 0], [6, 0]])
    assert np.isnan(velocity[1]).all()


def test_no_velocity_over_a_long_gap():
    stamps = np.array([0, 2_000_000_000])
    velocity = centred_velocities(np.zeros(2, int), stamps, np.array([[0.0, 0], [1, 0]]))
    assert np.isnan(velocity).all()
    assert centred_velocities(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2))).shape == (0, 2)

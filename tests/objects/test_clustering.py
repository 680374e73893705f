from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mottrack.core import InputError
from mottrack.geometry.hulls import hulls_of_groups
from mottrack.objects.clustering import box_mask, component_labels, split_large


def picture(*rows: str) -> np.ndarray:
    return np.array([[c != "." for c in row] for row in rows])


def label_image(occupied: np.ndarray, **options: object) -> np.ndarray:
    cells = component_labels(occupied, **options)
    image = np.full(occupied.shape, -1)
    image[cells.row, cells.column] = cells.label
    return image


def test_diagonal_neighbours_are_one_component() -> None:
    assert component_labels(picture("#..", ".#.", "..#")).number == 1
    assert component_labels(picture("#..#", "....", "#...")).number == 3


def test_gaps_are_bridged_where_asked_and_add_no_cells() -> None:
    occupied = picture("#..#....#")
    assert component_labels(occupied).number == 3
    joined = component_labels(occupied, join_cells=1)
    assert joined.number == 2
    assert len(joined.row) == 3


def test_a_detector_separates_touching_objects_and_keeps_one_whole() -> None:
    occupied = picture("####.##", "####.##")
    owner = np.full(occupied.shape, -1)
    owner[:, :2] = 0
    owner[:, 2:] = 1  # the second object has a gap
    image = label_image(occupied, owner=owner)
    assert len(np.unique(image[image >= 0])) == 2
    assert image[0, 1] != image[0, 2]
    assert image[0, 2] == image[0, 6]


def test_masked_cells_do_not_join_the_cells_outside() -> None:
    occupied = picture("#######")
    owner = np.full(occupied.shape, -1)
    owner[0, 3] = 0
    image = label_image(occupied, owner=owner, join_cells=2)
    assert len({image[0, 0], image[0, 3], image[0, 6]}) == 3


@settings(max_examples=30, deadline=None)
@given(arrays(np.bool_, (12, 15)))
def test_components_are_those_of_a_flood_fill(occupied: np.ndarray) -> None:
    image = label_image(occupied)
    for row, column in np.argwhere(occupied):
        near = image[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert set(near[near >= 0]) == {image[row, column]}
    assert (image >= 0).sum() == occupied.sum()


def test_tiles_of_a_long_wall_stay_where_they_are_as_the_grid_moves() -> None:
    wall = np.zeros((30, 30), np.bool_)
    wall[10, :] = True
    wall[20, 3:8] = True
    one = split_large(component_labels(wall), 10, (0, 0))
    other = split_large(component_labels(wall[:, 4:]), 10, (0, 4))
    assert one.number == 4
    edges = [
        np.flatnonzero(np.diff(c.label[c.row == 10])) + off for c, off in ((one, 0), (other, 4))
    ]
    np.testing.assert_array_equal(edges[0], edges[1])
    assert len(np.unique(one.label[one.row == 20])) == 1


def test_the_mask_of_a_turned_box() -> None:
    boxes = np.array([[5.0, 5.0, 6.0, 2.0, np.pi / 4]])
    owner = box_mask(boxes, (40, 40), 0.25)
    corners = shapely.affinity.rotate(shapely.box(2, 4, 8, 6), 45, origin=(5, 5))
    rows, columns = np.indices(owner.shape)
    inside = shapely.contains_xy(corners, (columns + 0.5) * 0.25, (rows + 0.5) * 0.25)
    assert (inside != (owner == 0)).mean() < 0.002


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=5),
    st.integers(0, 2**16),
    st.sampled_from([0.0, 1.0]),
)
def test_hulls_equal_shapelys(sizes: list[int], seed: int, rounding: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(sum(sizes), 2)) * [5, 1]
    if rounding:
        points = np.round(points)  # many points on one line, and twice the same
    start = np.concatenate([[0], np.cumsum(sizes)])
    hulls = hulls_of_groups(points, start)
    for group, polygon in enumerate(hulls.polygons()):
        expected = shapely.MultiPoint(points[start[group] : start[group + 1]]).convex_hull
        ours = shapely.Polygon(polygon)
        assert ours.exterior.is_ccw
        assert ours.buffer(1e-9).covers(expected)
        if expected.area > 1e-3:
            assert ours.area == pytest.approx(expected.area, abs=1e-9)
            centroid = expected.centroid
            np.testing.assert_allclose(hulls.centroid_m[group], [centroid.x, centroid.y], atol=1e-9)
            smallest = expected.minimum_rotated_rectangle.area
            assert hulls.rectangle[group, 2:4].prod() == pytest.approx(smallest, rel=1e-6)
        else:
            assert ours.area > 0


def test_a_group_without_points_has_no_hull() -> None:
    with pytest.raises(InputError, match=r"points of group\[1\] is 0, expected at least one"):
        hulls_of_groups(np.ones((3, 2)), np.array([0, 3, 3]))

import numpy as np
import pytest

from mottrack.core.flow_colour import colour_wheel, flow_to_rgb


def test_the_wheel_has_the_published_colours() -> None:
    wheel = colour_wheel()
    assert wheel.shape == (55, 3)
    assert wheel[0].tolist() == [1, 0, 0]  # red
    assert wheel[15].tolist() == [1, 1, 0]  # yellow after 15 steps
    assert wheel[25].tolist() == [0, 1, 1]  # cyan after 15 + 6 + 4
    assert wheel[36].tolist() == [0, 0, 1]  # blue after another 11


@pytest.mark.parametrize(
    ("direction", "name"), [((1, 0), "red"), ((0, -1), "yellow"), ((-1, 0), "cyan")]
)
def test_directions_have_the_colours_of_the_original_figure(
    direction: tuple[int, int], name: str
) -> None:
    rgb = flow_to_rgb(np.array(direction, float), 1.0)
    close = {"red": [1, 0, 0], "yellow": [1, 0.9, 0], "cyan": [0, 0.8, 1]}[name]
    np.testing.assert_allclose(rgb, close, atol=0.25)


def test_still_is_white_slow_is_pale_and_too_fast_is_darkened() -> None:
    right = np.array([1.0, 0.0])
    assert flow_to_rgb(0 * right, 10).tolist() == [1, 1, 1]
    slow, full, fast = (flow_to_rgb(right * s, 10) for s in (1, 10, 20))
    assert slow.min() > 0.8
    np.testing.assert_allclose(fast, 0.75 * full)

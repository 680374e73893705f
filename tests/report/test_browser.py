"""Interaction with the page in a headless browser."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import pytest

from mottrack.report.page import write_report
from mottrack.runs.comparison import Comparison

from .browser import Page, browser, find_browser
from .conftest import MARKUP

LAPTOP, PHONE = (1440, 900), (390, 844)
BINARY = find_browser()
pytestmark = pytest.mark.skipif(BINARY is None, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(str(BINARY), tmp_path_factory.mktemp("profile")) as page:
        yield page


@pytest.fixture
def page(tab: Page, comparison: Comparison, tmp_path: Path) -> Page:
    """Open the report anew in light mode at the size of a laptop."""
    path = tmp_path / "report.html"
    write_report(comparison, path)
    tab.errors.clear()
    tab.requests.clear()
    tab.resize(*LAPTOP)
    tab.open(path)
    tab.wait_for("document.getElementById('frame-label').textContent !== ''")
    return tab


def label(page: Page) -> str:
    return str(page.run("document.getElementById('frame-label').textContent"))


def pixels(page: Page) -> bytes:
    url = str(page.run("document.getElementById('view-0').toDataURL()"))
    return base64.b64decode(url.split(",")[1])


def choose(page: Page, identity: str, value: str) -> None:
    page.run(f"""(() => {{ const e = document.getElementById('{identity}');
        e.value = '{value}'; e.dispatchEvent(new Event('change')); }})()""")


def test_the_page_opens_without_errors_or_network_requests(page: Page) -> None:
    assert page.errors == []
    assert [r for r in page.requests if not r.startswith(("file:", "data:"))] == []
    assert page.run("document.querySelectorAll('#curves svg').length") == 4
    shown = page.run(
        "[...document.querySelectorAll('#distributions figcaption')].map((f) => f.innerText)"
    )
    assert shown == ["fast [3, inf) m/s", "all", "car"]  # in the order of the table


def test_a_term_has_a_tooltip(page: Page) -> None:
    page.run("document.querySelector('#tracking [data-tip]').focus()")
    tip = "document.getElementById('tip')"
    assert not page.run(f"{tip}.hidden")
    assert page.run(f"{tip}.textContent").startswith("Average multi-object tracking accuracy")
    page.key("Escape", 27)
    assert page.run(f"{tip}.hidden")


def test_slider_and_keys_move_through_the_frames(page: Page) -> None:
    page.run("document.getElementById('view-0').focus()")
    page.key("Home", 36)
    first, before = label(page), pixels(page)
    assert first == "frame 1 / 8 · 0.0 s"
    page.run("document.getElementById('slider').focus()")
    page.key("ArrowRight", 39)
    assert label(page) == "frame 2 / 8 · 0.1 s"
    after = pixels(page)
    assert after != before
    page.run("document.getElementById('view-0').focus()")
    page.key("End", 35)
    assert label(page).startswith("frame 8 / 8")
    page.key(" ", 32, " ")  # plays again from the start
    page.wait_for("document.getElementById('frame-label').textContent.startsWith('frame 3 /')")
    page.key(" ", 32, " ")
    assert page.run("document.getElementById('play').ariaLabel") == "Play"
    assert page.errors == []


def test_scenes_and_runs_are_selected_and_layers_toggled(page: Page) -> None:
    names = page.run("[...document.getElementById('scene').options].map((o) => o.text)")
    assert names == [MARKUP, "b"]  # a name that is markup is shown as text
    choose(page, "scene", "1")
    choose(page, "run-1", "0")
    page.wait_for("document.getElementById('name-1').textContent === 'zero'")
    assert not page.run("document.getElementById('pane-1').hidden")
    before = pixels(page)
    page.run("document.querySelector('#layers input').click()")
    assert pixels(page) != before
    assert page.errors == []


def test_errors_are_listed_and_stepped_through(page: Page) -> None:
    page.run("document.getElementById('view-0').focus()")
    page.key("Home", 36)
    assert page.run("document.getElementById('errors-count').textContent") == (
        "0 in this frame, 2 in the scene"
    )
    for frame in (4, 5, 4):  # wraps around after the last error
        page.run("document.getElementById('error-next').click()")
        assert label(page).startswith(f"frame {frame} / 8")
        assert page.run("document.querySelector('#error-list small').textContent").startswith("gap")
    before = pixels(page)
    page.run("document.querySelector('#error-kinds input').click()")  # misses are deselected
    assert page.run("document.getElementById('error-list').textContent") == "none in this frame"
    assert pixels(page) != before


def test_a_scene_opens_where_flow_moves_and_plays_at_the_rate_of_the_data(page: Page) -> None:
    assert label(page) == "frame 2 / 8 · 0.1 s"  # the first frame has no earlier sweep, so no flow
    assert page.run("document.getElementById('speed').value") == "1"


def test_dark_mode_follows_the_system_until_the_button_is_used(page: Page) -> None:
    background = "getComputedStyle(document.body).backgroundColor"
    light, drawn = page.run(background), pixels(page)
    page.resize(*LAPTOP, dark=True)
    page.wait_for("document.documentElement.dataset.theme === 'dark'")
    assert page.run(background) != light
    assert pixels(page) != drawn
    page.run("document.getElementById('theme').click()")
    assert page.run(background) == light
    page.run("localStorage.clear()")


def test_nothing_is_wider_than_a_phone_screen(page: Page) -> None:
    page.resize(*PHONE)
    page.run("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert page.run("document.documentElement.scrollWidth") <= PHONE[0]
    assert page.run("document.getElementById('view-0').clientWidth") > 0.8 * PHONE[0]
    cut = page.run("""[...document.querySelectorAll('.whiskers td')].filter((td) =>
        td.getBoundingClientRect().right > innerWidth).length""")
    assert cut == 0  # the verdict is seen without scrolling
    # the picture stays while the list of errors is scrolled
    page.run("document.getElementById('error-list').scrollIntoView({behavior: 'instant'})")
    seen = page.run("document.getElementById('view-0').getBoundingClientRect().bottom")
    assert seen > 100


def test_every_control_has_a_name_and_is_reachable_by_keyboard(page: Page) -> None:
    nameless = page.run("""[...document.querySelectorAll('button, select, input')].filter((e) =>
        !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).map((e) => e.outerHTML)""")
    assert nameless == []
    assert page.run("[...document.querySelectorAll('[tabindex]')].every((e) => e.tabIndex === 0)")


def test_a_link_leads_to_a_box_in_the_player(page: Page) -> None:
    page.run("location.hash = '#scene=b&run=1&frame=2&x=12.5&y=-3'")
    page.wait_for("document.getElementById('frame-label').textContent.startsWith('frame 3 ')")
    assert page.run("document.getElementById('scene').selectedOptions[0].textContent") == "b"
    assert page.run("document.getElementById('run-0').value") == "1"
    page.run("location.hash = '#scene=nowhere&frame=1'")
    assert label(page).startswith("frame 3 ")
    assert page.errors == []

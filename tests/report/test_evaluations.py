"""The sections on capabilities, slices, scores and labels, of runs and of any tracks."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mottrack.report.evaluations import FlowTables, Player, tracked_sections
from mottrack.report.page import write_report
from mottrack.report.panels import Panel, Series, Value
from mottrack.report.tracked_page import write_tracked_page
from mottrack.runs.comparison import Comparison
from mottrack.runs.tracked_run import of_folders, of_run

NAN = float("nan")


def test_a_report_has_every_section_with_every_run(comparison: Comparison, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path)
    text = path.read_text()
    for anchor in ("scene-flow", "capabilities", "slices", "calibration", "label-errors"):
        assert text.count(f'<section id="{anchor}">') == text.count(f'href="#{anchor}"') == 1
    curves = text.split('<section id="capabilities">')[1].split("</section>")[0]
    assert curves.count("<svg") >= 8
    assert "within 0.5: " in curves  # the tooltips


def test_a_suspected_label_has_a_link_to_its_place_in_the_player(comparison: Comparison) -> None:
    """The car with identity 1 loses its labels; the player counts from the vehicle's start."""
    run = comparison.runs[1]
    tracked = of_run(run)
    results = tuple(replace(r, truth=r.truth.select(r.truth.id != 1)) for r in tracked.results)
    # the toy tracker drops every fifth frame of a track and switches identities
    player = Player(("b",), {run.title: 1})
    broken = replace(tracked, results=results)
    (listed,) = tracked_sections({run.title: broken}, FlowTables(), player)["evaluations"][
        "suspects"
    ]
    links = {row.cells[0]: row.link for row in listed.rows}
    assert set(links) == set(run.finished)
    assert re.fullmatch(r"scene=b&run=1&frame=\d+&x=-?[\d.]+&y=-?[\d.]+", links["b"])
    assert links[next(name for name in links if name != "b")] == ""  # not in the player


def test_a_page_of_tracks_alone(comparison: Comparison, tmp_path: Path) -> None:
    known = of_folders([comparison.out])
    assert list(known) == [run.folder.path.name for run in comparison.runs]
    write_tracked_page(known, tmp_path / "tracks.html")
    text = (tmp_path / "tracks.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    assert '<section id="slices">' in text
    assert '<section id="scene-flow">' not in text


@pytest.mark.parametrize("ends", [(0.25, 0.75), (NAN, NAN)])
def test_points_lie_at_their_values(ends: tuple[float, float]) -> None:
    values = [Value(0.0, 0.5, ends, "first"), Value(1.0, NAN, (NAN, NAN), "none there")]
    series = Series(0, "run", values)
    panel = Panel("t", "x", "y", [series], [], x_end=1.0, y_end=1.0)
    (mark,) = panel.marks(series)
    assert mark.y == pytest.approx((panel.y(0.0) + panel.y(1.0)) / 2)
    assert mark.x == panel.x(0.0)
    assert (mark.ends is None) == np.isnan(ends[0])

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from mottrack.core import ConfigError
from mottrack.report.page import write_report
from mottrack.runs.comparison import Comparison, load_comparison

VOID = {"wbr", "meta", "img", "br", "link", "input", "line", "rect"}


class Outline(HTMLParser):
    """Collects the texts of the table cells and checks that every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, _attrs: object) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"td", "th"}:
            self.cells.append(data.strip())


def test_the_report_is_one_page_that_loads_nothing(comparison: Comparison, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path)
    text = path.read_text()
    page = Outline(text)
    assert page.open == []
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    for loader in ("@import", "url(", "fetch("):
        assert loader not in text
    assert "toy/poison.bin: point 7 is nan" in text
    error = comparison.runs[0].scores.velocity["fast [3, inf) m/s"]
    assert f"{error.mean_mps:.3f}" in page.cells


def test_names_and_settings_are_escaped(comparison: Comparison, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path)
    text = path.read_text()
    assert "<script>alert" not in text
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in text  # the title
    assert text.count("</script>") == text.count("<script")


def test_the_report_of_a_stored_comparison_is_identical(
    comparison: Comparison, tmp_path: Path
) -> None:
    write_report(comparison, tmp_path / "then.html")
    write_report(load_comparison(comparison.out), tmp_path / "later.html")
    assert (tmp_path / "then.html").read_bytes() == (tmp_path / "later.html").read_bytes()


def test_too_few_scenes_for_an_interval_are_reported(
    comparison: Comparison, tmp_path: Path
) -> None:
    differences = tuple(
        replace(d, rows=tuple(replace(r, low=math.nan, high=math.nan) for r in d.rows))
        for d in comparison.differences
    )
    path = tmp_path / "report.html"
    write_report(replace(comparison, differences=differences), path)
    text = path.read_text()
    assert "Against zero: too few scenes for a confidence interval." in text
    assert ">too few scenes</td>" in text


def test_a_folder_without_runs_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no finished scene"):
        load_comparison(tmp_path)


def test_scenes_that_do_not_fit_are_listed(comparison: Comparison, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path, max_mb=0.0)
    text = path.read_text()
    assert "Omitted to limit the file size" in text
    assert 'id="player"' not in text


def test_scenes_without_truth_are_not_scored(comparison: Comparison, tmp_path: Path) -> None:
    runs = []
    for run in comparison.runs:
        overall = run.scores.overall
        nothing = replace(overall, clear=replace(overall.clear, truth=0))
        unscored = replace(run)
        vars(unscored)["scores"] = replace(run.scores, overall=nothing)
        runs.append(unscored)
    write_report(replace(comparison, runs=tuple(runs)), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "no truth, so there are no scores" in text
    assert text.count('<div class="card">') == 1  # time
    assert 'id="tracking"' not in text

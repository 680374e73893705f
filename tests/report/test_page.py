import html
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from mottrack.core import ConfigError
from mottrack.experiment.experiment import load_experiments
from mottrack.report.page import write_report
from mottrack.report.ranking import report_runs
from mottrack.report.summary import share
from mottrack.runs.comparison import Comparison, load_comparison
from mottrack.runs.velocity_bench import plain_words

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
    assert text.count('<div class="card">') == 1  # latency
    for section in ("tracking", "velocity", "flow", "differences", "error-classes"):
        assert f'id="{section}"' not in text


def test_the_first_card_says_what_flow_was_worth(comparison: Comparison, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path)
    cards = path.read_text().split('<div class="cards">')[1]
    first = cards.split('<div class="card"')[1]
    assert "What flow was worth" in first
    for line in plain_words(comparison.flow_values):
        assert html.escape(line) in first


def test_only_significant_differences_are_coloured(comparison: Comparison, tmp_path: Path) -> None:
    """The interval decides, not which value is larger."""

    def written(low: float, high: float) -> str:
        differences = tuple(
            replace(d, rows=tuple(replace(r, low=low, high=high) for r in d.rows))
            for d in comparison.differences
        )
        path = tmp_path / "report.html"
        write_report(replace(comparison, differences=differences), path)
        return path.read_text()

    unsure = written(-1.0, 1.0)
    assert "no significant difference in any metric" in unsure
    assert not re.search(r'class="(is-)?(better|worse)', unsure)
    assert "is significantly" in written(0.5, 1.0)


def test_the_better_run_has_the_longer_bar_whatever_the_direction() -> None:
    assert share(0.2, 0.0, 1.0) > share(0.9, 0.0, 1.0) > 0.0  # errors
    assert share(0.8, 1.0, 0.0) > share(0.7, 1.0, 0.0)  # accuracies
    assert share(-0.309, 1.0, -0.331) > share(-0.331, 1.0, -0.331) > 0.0  # a negative MOTA
    assert share(math.nan, 0.0, 1.0) == 0.0
    assert share(0.0, 0.0, 0.0) == 1.0


def test_equal_runs_are_shown_once(comparison: Comparison, tmp_path: Path) -> None:
    first, second = comparison.runs
    twin = replace(first, experiment=replace(first.experiment, variant="twin"))
    shown = report_runs([first, twin, second])
    assert [(run.title, run.same) for run in shown] == [
        (first.title, ("twin",)),
        (second.title, ()),
    ]
    write_report(replace(comparison, runs=(first, twin, second)), tmp_path / "report.html")
    assert "= twin" in (tmp_path / "report.html").read_text()


def test_a_flow_source_keeps_its_colour(comparison: Comparison) -> None:
    first, second = comparison.runs
    colours = {run.title: run.colour for run in report_runs([second, first])}
    assert colours == {run.title: run.colour for run in report_runs([first, second])}


def test_the_title_is_that_of_the_data(tmp_path: Path) -> None:
    data = f"dataset={{kind: folder, root: {tmp_path / 'my_logs'}}}"
    (own,) = load_experiments("demo", [data, "flow=zero"])
    assert own.name == "folder: my_logs"
    (named,) = load_experiments("demo", [data, "flow=zero", "name=Mondays"])
    assert named.name == "Mondays"
    (shipped,) = load_experiments("demo", ["flow=zero", "dataset.seed=3"])
    assert shipped.name == "Embedded world, flow sources compared"

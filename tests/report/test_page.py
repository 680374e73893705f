import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from mottrack.pipeline.comparison import Comparison, run_comparison
from mottrack.pipeline.experiment import compose
from mottrack.report.page import write_report

TOYS = Path(__file__).parents[1] / "pipeline"


class SilentProgress:
    def begin(self, title: str, scenes: int, todo: int) -> None: ...

    def frames(self, scene: str, done: int, total: int) -> None: ...

    def scene_ends(self, outcome: object) -> None: ...


class Outline(HTMLParser):
    """Collects what stands in the page's cells, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"td", "th"}:
            self.cells.append(data.strip())


@pytest.fixture
def comparison(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Comparison:
    monkeypatch.syspath_prepend(str(TOYS))
    tree = {
        "name": "<toys & more>",
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": ["a", "poison"]},
        "flow": [{"kind": "zero"}, {"kind": "toy_plugins:ConstantFlow"}],
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    experiments = compose(tree, [], Path("toy.yaml"))
    return run_comparison(experiments, tmp_path / "run", workers=2, progress=SilentProgress())


def test_the_report_is_one_whole_page_that_needs_no_network(
    comparison: Comparison, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    write_report(comparison, path)
    text = path.read_text()
    page = Outline(text)
    assert page.open == []
    assert "&lt;toys &amp; more&gt;" in text
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert "toy/poison.bin: point 7 is nan" in text
    error = comparison.runs[0].scores.velocity["fast [3, inf) m/s"]
    assert f"{error.mean_mps:.3f}" in page.cells
    assert text.count("data:image/png;base64,") == 2  # the bars and the finished scene

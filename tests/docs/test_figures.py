"""No figure lacks its section, and every number of the examples is what the library gives."""

from __future__ import annotations

import doctest
import re

import pytest

from mottrack.eval.metric_info import FLOW, PROTOCOLS, TRACKING, VELOCITY

from .conftest import REPOSITORY, blocks

PAGE = REPOSITORY / "docs/figures.md"
PARTS = ("Definition", "Formula", "Source", "Punishes", "Example", "Under stress")
EVERY = (*TRACKING, *VELOCITY, *FLOW, *PROTOCOLS)
HEADING = re.compile(r'^<a id="(\w+)"></a>\n\n## .*$', re.MULTILINE)


def sections() -> dict[str, str]:
    """Return the text below each heading with an anchor, by the anchor."""
    _, *found = HEADING.split(PAGE.read_text("utf-8"))
    return dict(zip(found[::2], found[1::2], strict=True))


def test_every_figure_has_its_section_and_every_section_its_figure() -> None:
    assert sorted(sections()) == sorted(info.key for info in EVERY)


@pytest.mark.parametrize("key", [info.key for info in EVERY])
def test_every_section_is_whole(key: str) -> None:
    text = sections()[key]
    for part in PARTS:
        assert re.search(rf"^\*\*{part}\.\*\* \S", text, re.MULTILINE), part
    assert ">>> " in text


def test_every_figure_is_in_the_table_of_damages() -> None:
    text = PAGE.read_text("utf-8")
    for info in EVERY:
        if info.key == "samota":
            continue  # needs boxes in an image
        assert f"| [{info.name}](#{info.key}) |" in text


def test_every_number_of_the_examples() -> None:
    code = "\n".join(blocks(PAGE, "pycon"))
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    example = doctest.DocTestParser().get_doctest(code, {}, "figures.md", str(PAGE), 0)
    output: list[str] = []
    runner.run(example, out=output.append)
    assert not runner.failures, "".join(output)
    assert len(example.examples) > len(EVERY)

"""Every link of the texts resolves in the clone; generated pages are what would be generated."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from .conftest import REPOSITORY, TEXTS, blocks, names

FILES = [*TEXTS, REPOSITORY / "CONTRIBUTING.md"]
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCED = re.compile(r"^ *```.*?^ *```$", re.DOTALL | re.MULTILINE)


def anchors(file: Path) -> set[str]:
    """Return the fragments of a page as its hosts make them from the headings."""
    text = FENCED.sub("", file.read_text("utf-8"))
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}
    return slugs | set(re.findall(r'<a id="([^"]+)">', text))


@pytest.mark.parametrize("text", names(FILES))
def test_links_of(text: str) -> None:
    file = REPOSITORY / text
    for link in LINK.findall(FENCED.sub("", file.read_text("utf-8"))):
        if "://" in link:
            continue
        target, _, fragment = link.partition("#")
        there = (file.parent / target).resolve() if target else file
        assert there.exists(), f"{text}: {link}"
        if fragment:
            assert fragment in anchors(there), f"{text}: {link}"


@pytest.mark.parametrize("text", names(FILES))
def test_nothing_is_left_to_be_included(text: str) -> None:
    content = (REPOSITORY / text).read_text("utf-8")
    assert "--8<--" not in content
    assert not re.search(r"^::: ", content, re.MULTILINE)


def test_programs_in_the_texts_are_those_of_the_examples() -> None:
    whole = {file.read_text("utf-8").rstrip() for file in REPOSITORY.glob("examples/*.py")}
    examples = whole | {text.partition('\n\n\nif __name__ == "__main__"')[0] for text in whole}
    shown = [(file.name, code.rstrip()) for file in TEXTS for code in blocks(file, "py")]
    assert len(shown) >= 4
    assert [name for name, code in shown if code not in examples] == []


@pytest.mark.usefixtures("page_makers")
def test_generated_pages_are_up_to_date() -> None:
    """Else: python docs/generate/write.py"""
    wanted = importlib.import_module("write").pages()
    folder = REPOSITORY / "docs" / "reference"
    assert {file.name for file in folder.glob("*.md")} == set(wanted)
    stale = [n for n, text in wanted.items() if (folder / n).read_text("utf-8") != text]
    assert stale == [], "run python docs/generate/write.py"


def test_every_page_is_in_the_navigation() -> None:
    navigation = (REPOSITORY / "mkdocs.yml").read_text("utf-8")
    for file in (REPOSITORY / "docs").rglob("*.md"):
        assert str(file.relative_to(REPOSITORY / "docs")) in navigation

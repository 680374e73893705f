"""Hooks of mkdocs: add the pages of the top folder and convert formulas to MathML.

Browsers render MathML natively, so no page loads a script or a font from the network.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = {
    "changelog.md": lambda: (REPOSITORY / "CHANGELOG.md").read_text("utf-8"),
    "contributing.md": lambda: (REPOSITORY / "CONTRIBUTING.md").read_text("utf-8"),
}
FORMULA = re.compile(r'<(div|span) class="arithmatex">\\([\[(])(.*?)\\[\])]</\1>', re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages."""
    for path, page in PAGES.items():
        files.append(File.generated(config, path, content=page()))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Replace LaTeX by MathML."""
    return FORMULA.sub(_formula, content)


def _formula(match: re.Match[str]) -> str:
    block = match[2] == "["
    drawn = convert(html.unescape(match[3]), display="block" if block else "inline")
    return f'<div class="formula">{drawn}</div>' if block else drawn

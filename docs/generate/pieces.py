"""Small pieces of Markdown."""

from __future__ import annotations

from collections.abc import Iterable


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; line breaks and bars inside cells are taken care of."""
    first = list(head)
    lines = [first, ["---"] * len(first), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines) + "\n"


def code(text: object) -> str:
    """Inline code; nothing for nothing."""
    return f"`{text}`" if str(text) else ""


def paragraphs(docstring: str | None) -> str:
    """A docstring as plain Markdown, double back-ticks made single."""
    return (docstring or "").replace("``", "`") + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")

"""Markdown tables, code and paragraphs."""

from __future__ import annotations

from collections.abc import Iterable


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table; line breaks and bars inside cells are escaped."""
    first = list(head)
    lines = [first, ["---"] * len(first), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines) + "\n"


def code(text: object) -> str:
    """Return inline code; an empty string for an empty text."""
    return f"`{text}`" if str(text) else ""


def paragraphs(docstring: str | None) -> str:
    """Return a docstring as Markdown, with single back-ticks."""
    return (docstring or "").replace("``", "`") + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")

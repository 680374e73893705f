"""Values of files as they may be printed: without control characters, and cut."""

from __future__ import annotations

MAX_SHOWN = 100
"""Characters of a value in a message: one line of a terminal."""
MAX_MESSAGE = 2_000
"""Characters of a whole message; lists of valid names are the longest that we write ourselves."""
_CUT = "..."


def printable(text: str, most: int | None = None) -> str:
    """Return the text with what is not printable escaped, cut in the middle to `most` characters.

    A name out of a file may hold commands to the terminal, line breaks that forge a message, or
    half a surrogate pair that no encoding takes.
    """
    if most is not None and len(text) > most:
        head = (most - len(_CUT)) * 2 // 3
        text = text[:head] + _CUT + text[len(text) - (most - len(_CUT) - head) :]
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _escaped(c) for c in text)


def shown(value: object, most: int = MAX_SHOWN) -> str:
    """Return a value for a message, in at most about `most` characters."""
    try:
        text = str(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, a list in itself
        text = f"a {type(value).__name__} that is too long to print"
    return printable(text, most)


def quoted(value: object, most: int = MAX_SHOWN) -> str:
    """Return a value as Python writes it, texts in quotation marks, likewise cut."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return shown(value, most)
    return printable(text, most)


def _escaped(character: str) -> str:
    code = ord(character)
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"

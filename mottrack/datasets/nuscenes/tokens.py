"""Tokens: 32 hexadecimal digits that follow from what they name."""

from __future__ import annotations

import hashlib


def token_of(kind: str, *parts: object) -> str:
    """Return the token of a record; the same parts give the same token on every machine."""
    text = "/".join([kind, *map(str, parts)])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

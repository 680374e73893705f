"""Strict loading of untrusted YAML: no objects, repeated keys, alias bombs or huge files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml
from yaml.nodes import MappingNode

from mottrack.core.errors import DataError

MAX_BYTES = 1 << 20
"""Hundreds of times a real configuration; the parser is pure Python and slow on a wrong file."""
MAX_ALIASES = 50
"""Nested aliases grow exponentially (a "billion laughs" bomb)."""
MAX_DEPTH = 20
"""Far beyond the nesting of any setting; without a limit the parser exhausts the stack."""
_EXPONENTIAL = re.compile(r"[-+]?\d+(\.\d*)?e[-+]?\d+", re.IGNORECASE)


class _StrictLoader(yaml.SafeLoader):
    """The safe loader, with repeated keys and excess aliases refused."""

    aliases = 0
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:  # the base class has no annotations
        if self.check_event(yaml.AliasEvent):
            self.aliases += 1
            if self.aliases > MAX_ALIASES:
                raise yaml.YAMLError(f"more than {MAX_ALIASES} aliases")
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise yaml.YAMLError(f"nested deeper than {MAX_DEPTH}")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.YAMLError(f"key {key!r} is not a string")
            if key in seen:
                raise yaml.YAMLError(f"key '{key}' twice, line {key_node.start_mark.line + 1}")
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a mapping from a file.

    Raises:
        DataError: the file is missing, over 1 MB, not YAML, or not a mapping.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise DataError(path, "size", f"{size} bytes", f"at most {MAX_BYTES}")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(path, "file", error.strerror, "a readable YAML file") from error
    except UnicodeDecodeError as error:
        raise DataError(path, "encoding", str(error), "UTF-8") from error
    return parse_yaml(text, path)


def parse_yaml(text: str, source: Path) -> dict[str, Any]:
    """Parse a mapping; ``source`` names it in errors.

    Raises:
        DataError: the text is not YAML, not a mapping, or an alias leads back to itself.
    """
    try:
        content = yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - derived from SafeLoader
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise DataError(source, "content", reason, "YAML") from error
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise DataError(source, "content", type(content).__name__, "a mapping of keys to values")
    _refuse_cycles(content, source)
    return content


def _refuse_cycles(content: dict[str, Any], source: Path) -> None:
    try:
        json.dumps(content, default=str)
    except ValueError as error:
        raise DataError(source, "content", "an alias inside its own anchor", "a tree") from error


def parse_scalar(text: str) -> Any:
    """Return the value of ``text`` in YAML: ``0.5`` is a number, ``[a, b]`` a list.

    Unlike YAML 1.1, ``1e-3`` is a number and ``on``/``off``/``yes``/``no`` stay words.
    """
    if text.lower() in {"on", "off", "yes", "no"}:
        return text
    if _EXPONENTIAL.fullmatch(text):
        return float(text)
    try:
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506
    except yaml.YAMLError:
        return text

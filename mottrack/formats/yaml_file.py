"""Strict loading of untrusted YAML: no objects, repeated keys, alias bombs or huge files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_NODES

MAX_BYTES = 1 << 20
"""Hundreds of times a real configuration; the parser is pure Python and slow on a wrong file."""
MAX_ALIASES = 50
"""Nested aliases grow exponentially (a "billion laughs" bomb)."""
MAX_DEPTH = 20
"""Far beyond the nesting of any setting; without a limit the parser exhausts the stack."""
_KINDS = {
    "int": "an integer of at most 4300 digits",  # Python reads no more of them
    "float": "a number",
    "bool": "true or false",
    "timestamp": "a date",
}
"""What a value of each of YAML's types must be, for errors."""
_EXPONENTIAL = re.compile(r"[-+]?\d+(\.\d*)?e[-+]?\d+", re.IGNORECASE)


class _ScalarError(yaml.YAMLError):
    """A value that its tag does not fit: a number of thousands of digits, `!!bool maybe`."""

    def __init__(self, node: ScalarNode) -> None:
        kind = node.tag.rpartition(":")[2]
        super().__init__(kind)
        self.line, self.value = node.start_mark.line + 1, node.value
        self.expected = _KINDS.get(kind, f"a value of type {kind}")


_FAULTS = (
    yaml.YAMLError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    RecursionError,
)
"""What the parser raises on texts that are no YAML of settings."""


class _StrictLoader(yaml.SafeLoader):
    """The safe loader, with repeated keys and excess aliases refused; dates stay text."""

    yaml_implicit_resolvers = {  # noqa: RUF012 - as in the base class
        first: [(tag, pattern) for tag, pattern in rules if tag != "tag:yaml.org,2002:timestamp"]
        for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    aliases = 0
    depth = 0

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _require_small(node)
        return node

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

    def construct_object(self, node: Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, KeyError, OverflowError, AttributeError, IndexError) as error:
            if isinstance(node, ScalarNode):
                raise _ScalarError(node) from error
            raise

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


def _require_small(root: Node) -> None:
    """Refuse a tree that grows too large, or without end, once its aliases are written out."""
    sizes: dict[int, int] = {}
    within: set[int] = set()

    def size(node: Node) -> int:
        if id(node) in within:
            raise yaml.YAMLError("an alias inside its own anchor")
        if id(node) not in sizes:
            within.add(id(node))
            sizes[id(node)] = 1 + sum(map(size, _children(node)))
            within.remove(id(node))
        return sizes[id(node)]

    if size(root) > MAX_NODES.value:
        raise yaml.YAMLError(f"{size(root)} values, {MAX_NODES.expected('values')}")


def _children(node: Node) -> list[Node]:
    if isinstance(node, MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, SequenceNode) else []


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
        raise DataError(path, "encoding", f"byte {error.start} is no UTF-8", "UTF-8") from error
    return parse_yaml(text, path)


def parse_yaml(text: str, source: Path) -> dict[str, Any]:
    """Parse a mapping; ``source`` names it in errors.

    Raises:
        DataError: the text is not YAML, not a mapping, or an alias leads back to itself.
    """
    try:
        content = yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - derived from SafeLoader
    except _ScalarError as error:
        raise DataError(source, f"line {error.line}", error.value, error.expected) from error
    except _FAULTS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(source, "content", reason, "YAML") from error
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise DataError(source, "content", type(content).__name__, "a mapping of keys to values")
    return content


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
    except _FAULTS:
        return text

"""Overrides ``key=value`` and sweeps, in Hydra's syntax: ``flow=icp``, ``tracker.gate=5,7``."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from mottrack.core.errors import ConfigError
from mottrack.formats.yaml_file import parse_scalar

GROUPS = ("dataset", "objects", "flow", "tracker")


class Choice(NamedTuple):
    """One value of a key."""

    key: str
    value: Any


Knows = Callable[[Sequence[Choice], str, str], bool]
"""Whether the part that the choices name in a group has a key."""


class Variant(NamedTuple):
    """One combination of a sweep."""

    name: str
    """Its values that vary; empty for a single combination."""
    choices: list[Choice]


def parse_override(text: str) -> tuple[str, list[Any]]:
    """Split ``key=value`` into the key and its values; commas outside brackets make a sweep.

    Raises:
        ConfigError: there is no ``=``, or the key or a value is empty.
    """
    key, sign, value = text.partition("=")
    key = key.strip()
    if not sign or not key or not all(key.split(".")):
        raise ConfigError(f"override '{text}' is not of the form key=value")
    parts = _split_outside_brackets(value)
    if len(parts) > 1 and not all(p.strip() for p in parts):
        raise ConfigError(f"override '{text}' has an empty value between commas")
    return key, [parse_scalar(p.strip()) for p in parts]


def data_settings(overrides: Sequence[str]) -> dict[str, Any]:
    """Return the settings of one data set, `dataset.` before a key or not.

    Raises:
        ConfigError: an override has several values, or is none.
    """
    settings = {}
    for override in overrides:
        key, values = parse_override(override)
        if len(values) != 1:
            raise ConfigError(f"override '{override}' has several values, expected one")
        settings[key.removeprefix("dataset.")] = values[0]
    return settings


def expand(tree: Mapping[str, Any], overrides: Sequence[str]) -> list[Variant]:
    """Return all combinations of a sweep.

    A list under a group in the file (``flow: [zero, icp]``) and a list on the command line
    (``flow=zero,icp``) both make a sweep; the command line wins. The order is that of the file,
    then of the command line.

    Raises:
        ConfigError: an override is malformed, or a list is empty.
    """
    axes: dict[str, list[Any]] = {g: list(tree[g]) for g in GROUPS if isinstance(tree.get(g), list)}
    for text in overrides:
        key, values = parse_override(text)
        axes.pop(key, None)
        axes[key] = values
    empty = [key for key, values in axes.items() if not values]
    if empty:
        raise ConfigError(f"{empty[0]} is an empty list, expected at least one value")
    ordered = sorted(axes, key=lambda key: key not in GROUPS)  # a group first, then its fields
    variants = []
    for combination in itertools.product(*(axes[key] for key in ordered)):
        choices = [Choice(*pair) for pair in zip(ordered, combination, strict=True)]
        swept = [choice for choice in choices if len(axes[choice.key]) > 1]
        variants.append(Variant(_variant_name(swept), choices))
    return variants


def fitting(variants: Sequence[Variant], knows: Knows) -> list[Variant]:
    """Drop ``flow.key=...`` from those variants of a swept group whose part has no such key.

    So ``flow=zero,icp flow.starts=1`` sets it for ICP alone. A key that no variant knows stays: it
    is a mistake, which is told where the part is made.

    Args:
        variants: of a sweep.
        knows: whether a variant's part of a group has a key: choices, group, key within it.
    """
    names = dict.fromkeys(c.key for v in variants for c in v.choices if _in_group(c.key))
    strange: dict[str, set[str]] = {}
    for key in names:
        group, _, inner = key.partition(".")
        lacking = {v.name for v in variants if not knows(v.choices, group, inner)}
        if len(lacking) < len(variants):
            strange[key] = lacking
    found: dict[str, Variant] = {}
    for name, choices in variants:
        kept = [c for c in choices if name not in strange.get(c.key, ())]
        swept = [c for c in kept if _swept(c.key, variants)]
        fitted = Variant(_variant_name(swept), kept)
        found.setdefault(fitted.name, fitted)
    return list(found.values())


def _in_group(key: str) -> bool:
    return key.partition(".")[0] in GROUPS and "." in key


def _swept(key: str, variants: Sequence[Variant]) -> bool:
    values = [str(c.value) for v in variants for c in v.choices if c.key == key]
    return len(set(values)) > 1


def set_key(tree: dict[str, Any], key: str, value: Any) -> None:
    """Set ``a.b.c`` in nested mappings, creating those that are missing.

    Raises:
        ConfigError: the key leads through something that is not a mapping.
    """
    *parents, last = key.split(".")
    for depth, name in enumerate(parents):
        tree = tree.setdefault(name, {})
        if not isinstance(tree, dict):
            raise ConfigError(f"'{'.'.join(parents[: depth + 1])}' has no key to set in '{key}'")
    tree[last] = value


def _variant_name(choices: Iterable[Choice]) -> str:
    names = []
    for key, value in choices:
        label = value.get("name", value.get("kind", "?")) if isinstance(value, dict) else value
        names.append(str(label) if key in GROUPS else f"{key.rpartition('.')[2]}={label}")
    return "+".join(names).replace("/", "_")


def _split_outside_brackets(text: str) -> list[str]:
    depth, parts = 0, [""]
    for character in text:
        depth += (character in "[{(") - (character in "]})")
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts

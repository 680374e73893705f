"""Resolve names of parts to classes: from the package's tables, or ``module:Class`` plug-ins."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from pydantic import ValidationError

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, unknown_name
from mottrack.core.interfaces import Dataset, FlowSource, ObjectSource, TableEntry, Tracker
from mottrack.core.printed import shown
from mottrack.experiment.tables import TABLES
from mottrack.experiment.validation_message import format_validation_error


class PartKind(NamedTuple):
    """One of the four parts of an experiment."""

    noun: str
    """In error messages."""
    plural: str
    """In `mottrack list`."""
    protocol: type[Any]
    """Its public methods and its attributes are what a class must have."""
    shared: tuple[str, ...] = ()
    """Keywords that the pipeline passes to the constructor, beside the settings."""

    @property
    def table(self) -> Mapping[str, TableEntry]:
        """The classes that are shipped."""
        return TABLES[self.plural]


PARTS = {
    "dataset": PartKind("dataset", "datasets", Dataset),
    "objects": PartKind("object source", "objects", ObjectSource),
    "flow": PartKind("flow source", "flows", FlowSource, ("grid",)),
    "tracker": PartKind("tracker", "trackers", Tracker),
}


@dataclass(frozen=True)
class Part:
    """A class and its checked configuration, ready to be constructed."""

    kind: str
    cls: type[Any]
    config: StrictModel | dict[str, Any]
    """A model where the class declares ``Config``; else plain arguments."""

    def make(self, **shared: Any) -> Any:
        """Construct the object; ``shared`` are the keywords of its `PartKind`."""
        if isinstance(self.config, StrictModel):
            return self.cls(self.config, **shared)
        return self.cls(**self.config, **shared)

    def files(self) -> tuple[Path, ...]:
        """Return the files beside the settings and the data that decide results: weights.

        Raises:
            DataError: none of that name are shipped.
        """
        return self.config.files() if isinstance(self.config, StrictModel) else ()

    def resolved(self) -> dict[str, Any]:
        """Return every setting, defaults included, as plain data."""
        if isinstance(self.config, StrictModel):
            return {"kind": self.kind, **self.config.model_dump(mode="json")}
        return {"kind": self.kind, **self.config}


def load_part(group: str, settings: Mapping[str, Any]) -> Part:
    """Find the class that ``settings["kind"]`` names and check the other settings.

    Args:
        group: ``"dataset"``, ``"objects"``, ``"flow"`` or ``"tracker"``.
        settings: ``kind`` and the settings of that class.

    Raises:
        ConfigError: the name is unknown, the class can't be imported or does not fulfil its
            protocol, or a setting is wrong.
    """
    parameters = {k: v for k, v in settings.items() if k != "kind"}
    kind, part = settings.get("kind"), PARTS[group]
    if not isinstance(kind, str):
        raise ConfigError(f"{group}.kind is {kind!r}, expected a name: {', '.join(part.table)}")
    cls = _find_class(part, kind)
    config: StrictModel | dict[str, Any] = parameters
    if "Config" in dir(cls):
        try:
            config = cls.Config.model_validate(parameters)
        except ValidationError as error:
            message = format_validation_error(error, cls.Config, prefix=group)
            raise ConfigError(message) from error
    _check_call(part, kind, cls, config)
    return Part(kind, cls, config)


def has_key(group: str, kind: str, key: str) -> bool:
    """Return whether the class that ``kind`` names has a setting; true where there is no class.

    Args:
        group: as for `load_part`.
        kind: name of the part.
        key: dotted, within the group; its first name decides.
    """
    try:
        cls = _find_class(PARTS[group], kind)
    except ConfigError:
        return True  # told where the part is made
    first = key.partition(".")[0]
    if "Config" in dir(cls):
        return first in cls.Config.model_fields
    parameters = inspect.signature(cls).parameters
    return first in parameters or any(p.kind is p.VAR_KEYWORD for p in parameters.values())


def _find_class(part: PartKind, kind: str) -> type[Any]:
    if kind not in part.table and ":" not in kind:
        raise unknown_name(part.noun, kind, part.table)
    target = part.table[kind].target if kind in part.table else kind
    module_name, _, class_name = target.partition(":")
    if module_name.startswith(".") or not module_name:
        expected = "expected package.module:Class, from the top"
        raise ConfigError(f"{part.noun} is '{shown(kind)}', {expected}")
    try:
        found = getattr(importlib.import_module(module_name), class_name)
    except Exception as error:
        reason = (
            str(error) if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
        )
        raise ConfigError(f"{part.noun} '{shown(kind)}' can't be imported: {reason}") from error
    if not isinstance(found, type):
        raise ConfigError(f"{part.noun} '{kind}' is a {type(found).__name__}, expected a class")
    _check_members(part, kind, found)
    return found


def _check_members(part: PartKind, kind: str, cls: type[Any]) -> None:
    """Refuse a class without the methods and attributes that its protocol declares."""
    members = vars(part.protocol).items()
    methods = [name for name, member in members if callable(member) and name[0] != "_"]
    names = dir(cls)
    for name in methods:
        if name not in names or not callable(getattr(cls, name)):
            raise ConfigError(
                f"{part.noun} '{kind}' has no {name}, expected methods {', '.join(methods)}"
            )
    for name, expected in get_type_hints(part.protocol).items():
        if name not in names or not isinstance(getattr(cls, name), expected):
            raise ConfigError(
                f"{part.noun} '{kind}' does not declare {name}, expected a class attribute of type "
                f"{expected.__name__}; mottrack.core.{part.protocol.__name__}Base has a default to "
                "inherit"
            )


def _check_call(
    part: PartKind, kind: str, cls: type[Any], settings: StrictModel | dict[str, Any]
) -> None:
    """Refuse settings that ``__init__`` does not take, and a class without a shared keyword."""
    positional, keywords = ([], settings) if isinstance(settings, dict) else ([settings], {})
    for name in part.shared:
        if name in keywords:
            raise ConfigError(f"{part.noun} '{kind}': {name} is set by {name}.*, for all parts")
    try:
        signature = inspect.signature(cls)
        signature.bind(*positional, **keywords, **dict.fromkeys(part.shared))
    except (TypeError, ValueError) as error:
        call = ", ".join(
            [f"{name}={value!r}" for name, value in keywords.items()]
            + [f"{name}=..." for name in part.shared]
        )
        raise ConfigError(
            f"{part.noun} '{kind}' can't be constructed with ({call}): {error}"
        ) from error

"""Names of parts become classes: from a sibling's table, or ``module:Class`` of the user's own."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, unknown_name
from mottrack.datasets import DATASETS
from mottrack.experiment.validation_message import format_validation_error
from mottrack.flow import FLOWS
from mottrack.objects import OBJECTS
from mottrack.trackers import TRACKERS

TABLES: dict[str, tuple[str, Mapping[str, str]]] = {
    "dataset": ("dataset", DATASETS),
    "objects": ("object source", OBJECTS),
    "flow": ("flow source", FLOWS),
    "tracker": ("tracker", TRACKERS),
}

METHODS = {
    "dataset": ("scene",),
    "objects": ("objects", "reset"),
    "flow": ("estimate", "reset"),
    "tracker": ("step",),
}
"""What a class must have; `mottrack.core.interfaces` says what each method does."""


@dataclass(frozen=True)
class Part:
    """A class and its checked configuration, ready to be made."""

    kind: str
    cls: type[Any]
    config: StrictModel | dict[str, Any]
    """A model for our own classes and those that declare ``Config``; else plain arguments."""

    def make(self, **shared: Any) -> Any:
        """A new object; ``shared`` holds what the pipeline hands to all parts of the group."""
        if isinstance(self.config, StrictModel):
            return self.cls(self.config, **shared)
        return self.cls(**self.config)

    def files(self) -> tuple[Path, ...]:
        """Files beside the settings and the data that decide results: weights.

        Raises:
            DataError: none of that name are shipped.
        """
        return self.config.files() if isinstance(self.config, StrictModel) else ()

    def resolved(self) -> dict[str, Any]:
        """Every setting, defaults included, as plain data."""
        if isinstance(self.config, StrictModel):
            return {"kind": self.kind, **self.config.model_dump(mode="json")}
        return {"kind": self.kind, **self.config}


def load_part(group: str, settings: Mapping[str, Any]) -> Part:
    """Finds the class that ``settings["kind"]`` names and checks the other settings.

    Args:
        group: ``"dataset"``, ``"objects"``, ``"flow"`` or ``"tracker"``.
        settings: ``kind`` and the settings of that class.

    Raises:
        ConfigError: the name is unknown, the class can't be imported, or a setting is wrong.
    """
    parameters = {k: v for k, v in settings.items() if k != "kind"}
    kind = settings.get("kind")
    if not isinstance(kind, str):
        raise ConfigError(
            f"{group}.kind is {kind!r}, expected a name: {', '.join(TABLES[group][1])}"
        )
    cls = _find_class(group, kind)
    model = getattr(cls, "Config", None)
    if model is None:
        _check_arguments(group, kind, cls, parameters)
        return Part(kind, cls, parameters)
    try:
        return Part(kind, cls, model.model_validate(parameters))
    except ValidationError as error:
        raise ConfigError(format_validation_error(error, model, prefix=group)) from error


def _find_class(group: str, kind: str) -> type[Any]:
    what, table = TABLES[group]
    if kind not in table and ":" not in kind:
        raise unknown_name(what, kind, table)
    module_name, _, class_name = table.get(kind, kind).partition(":")
    try:
        found = getattr(importlib.import_module(module_name), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"{what} '{kind}' can't be imported: {error}") from error
    if not isinstance(found, type):
        raise ConfigError(f"{what} '{kind}' is a {type(found).__name__}, expected a class")
    missing = [name for name in METHODS[group] if not callable(getattr(found, name, None))]
    if missing:
        expected = ", ".join(METHODS[group])
        raise ConfigError(f"{what} '{kind}' has no {missing[0]}, expected methods {expected}")
    return found


def _check_arguments(group: str, kind: str, cls: type[Any], arguments: dict[str, Any]) -> None:
    """Refuses settings of a class without ``Config`` that its ``__init__`` does not take."""
    try:
        inspect.signature(cls).bind(**arguments)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{group} '{kind}' does not take {arguments}: {error}") from error

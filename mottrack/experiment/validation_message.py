"""Says in one line everything that is wrong with a configuration."""

from __future__ import annotations

from difflib import get_close_matches
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails


def format_validation_error(
    error: ValidationError, model: type[BaseModel], *, prefix: str = ""
) -> str:
    """All problems, each with the key, the value and what was expected."""
    return "; ".join(_explain_one(item, model, prefix) for item in error.errors())


def _explain_one(item: ErrorDetails, model: type[BaseModel], prefix: str) -> str:
    path = [str(part) for part in item["loc"]]
    key = ".".join([prefix, *path] if prefix else path)
    if item["type"] == "extra_forbidden":
        valid = _fields_at(model, path[:-1])
        near = get_close_matches(path[-1], valid, n=1, cutoff=0.5)
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        return f"{key} is not a known key{hint}; valid: {', '.join(sorted(valid))}"
    if item["type"] == "missing":
        return f"{key} is missing"
    message = item["msg"].removeprefix("Value error, ")
    if not path:
        return f"{prefix or 'settings'}: expected {message}"
    return f"{key} is {item['input']!r}, expected: {message[0].lower()}{message[1:]}"


def _fields_at(model: type[BaseModel], path: list[str]) -> list[str]:
    for name in path:
        field = model.model_fields.get(name)
        inner = _model_in(field.annotation) if field is not None else None
        if inner is None:
            continue  # an index into a list or a key of a mapping
        model = inner
    return list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, UnionType, list, tuple, dict):
        for argument in get_args(annotation):
            found = _model_in(argument)
            if found is not None:
                return found
    return None

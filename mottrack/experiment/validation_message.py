"""Errors of pydantic as one line of text."""

from __future__ import annotations

from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mottrack.core.errors import did_you_mean
from mottrack.core.printed import quoted


def format_validation_error(
    error: ValidationError, model: type[BaseModel], *, prefix: str = ""
) -> str:
    """Return all problems in one line, each with the key, the value and what was expected."""
    unknown: dict[tuple[int | str, ...], list[str]] = {}
    said = []
    for item in error.errors():
        if item["type"] == "extra_forbidden":
            unknown.setdefault(item["loc"][:-1], []).append(str(item["loc"][-1]))
        else:
            said.append(_format_one(item, prefix))
    return "; ".join([*(_unknown(at, keys, model, prefix) for at, keys in unknown.items()), *said])


def _unknown(
    above: tuple[int | str, ...], names: list[str], model: type[BaseModel], prefix: str
) -> str:
    """Return which keys of one mapping are unknown, and the valid ones once."""
    path = [str(part) for part in above]
    keys = [".".join([prefix, *path, name] if prefix else [*path, name]) for name in names]
    valid = _fields_at(model, path)
    if len(keys) == 1:
        return f"{keys[0]} is not a known key{did_you_mean(names[0], valid)}"
    return f"{', '.join(keys)} are not known keys; valid: {', '.join(sorted(valid))}"


def _format_one(item: ErrorDetails, prefix: str) -> str:
    path = [str(part) for part in item["loc"]]
    key = ".".join([prefix, *path] if prefix else path)
    if item["type"] == "missing":
        return f"{key} is missing"
    if item["type"] == "int_parsing_size":
        return f"{key} is {quoted(item['input'])}, expected an integer of at most 4300 digits"
    message = item["msg"].removeprefix("Value error, ")
    if not path:
        return f"{prefix or 'settings'}: expected {message}"
    return f"{key} is {quoted(item['input'])}, expected: {message[0].lower()}{message[1:]}"


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

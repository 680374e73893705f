"""Every field of a pydantic model as (key, type, default, range, description)."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

NAMES = {float: "number", int: "integer", str: "text", bool: "true or false", NoneType: "null"}
BOUNDS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<", "min_length": "length ≥"}
BOUNDS |= {"max_length": "length ≤"}


class Row(NamedTuple):
    key: str
    type: str
    default: str
    range: str
    description: str


def rows(model: type[BaseModel], prefix: str = "", at: BaseModel | None = None) -> Iterator[Row]:
    """Yield the fields in order, those of nested models under their dotted keys.

    Args:
        model: the model.
        prefix: dotted key of the model, with its last dot.
        at: default value of the model in its parent, whose values are then the defaults.
    """
    if at is None and not any(f.is_required() for f in model.model_fields.values()):
        at = model()  # a preset may change the defaults of the fields
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True) if at is None else getattr(at, name)
        nested = _model_in(field.annotation)
        if nested is None or nested is not field.annotation:
            yield _row(f"{prefix}{name}", field, default)
        if nested is not None:
            inner = "" if inspect.isclass(field.annotation) else "<name>."
            given = default if isinstance(default, nested) else None
            yield from rows(nested, f"{prefix}{name}.{inner}", given)


def _row(key: str, field: FieldInfo, default: Any) -> Row:
    bounds = [
        f"{sign}&nbsp;{getattr(constraint, name):g}"
        for constraint in field.metadata
        for name, sign in BOUNDS.items()
        if getattr(constraint, name, None) is not None
    ]
    return Row(
        key,
        type_name(field.annotation),
        _value(default),
        ", ".join(bounds),
        field.description or "",
    )


def type_name(annotation: Any) -> str:
    """Return the kind of value: ``number``, ``auto, block or dense``, ``list of 2 numbers``."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return type_name(arguments[0])
    if origin is Literal:
        return " or ".join(str(a) for a in arguments)
    if origin in (Union, UnionType):
        return " or ".join(type_name(a) for a in arguments)
    if origin in (tuple, list):
        inner = dict.fromkeys(type_name(a) for a in arguments if a is not Ellipsis)
        many = "" if Ellipsis in arguments or origin is list else f"{len(arguments)} "
        return f"list of {many}{' or '.join(inner)}"
    if origin is dict:
        return f"mapping of {type_name(arguments[0])} to {type_name(arguments[1])}"
    return NAMES.get(annotation) or getattr(annotation, "__name__", str(annotation)).lower()


def _value(default: Any) -> str:
    if default is PydanticUndefined:
        return "required"
    if isinstance(default, bool) or default is None:
        return {True: "true", False: "false", None: "null"}[default]
    if isinstance(default, tuple | list):
        return f"[{', '.join(_value(item) for item in default)}]"
    if isinstance(default, dict):
        return "{}" if not default else ", ".join(default)
    return f"{default:g}" if isinstance(default, float) else str(default)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(argument) for argument in get_args(annotation))
    return next((model for model in found if model is not None), None)

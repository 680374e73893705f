"""A resolved experiment as YAML, with the description of every key beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import yaml
from pydantic import BaseModel

from mottrack.experiment.experiment import Experiment
from mottrack.experiment.overrides import GROUPS

COMMENT_COLUMN = 40
"""Where descriptions begin; longer lines have theirs two blanks after the value."""


def described(experiment: Experiment) -> str:
    """Return every setting, defaults included; the text is a configuration file of its own."""
    head = [f"# variant {experiment.variant}"] if experiment.variant else []
    lines = list(head)
    for group, part in zip(GROUPS, experiment.parts, strict=True):
        lines.append(f"{group}:")
        lines.append(f"  kind: {_scalar(part.kind)}")
        config = part.config
        if isinstance(config, BaseModel):
            lines += _lines(config, "  ")
        else:
            lines += [f"  {key}: {_scalar(value)}" for key, value in part.resolved().items()][1:]
    lines += _lines(experiment.settings, "")
    return "\n".join(lines) + "\n"


def _lines(model: BaseModel, indent: str) -> Iterator[str]:
    plain = model.model_dump(mode="json")
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            about = f"# {field.description}" if field.description else ""
            yield _beside(f"{indent}{name}:", about)
            yield from _lines(value, indent + "  ")
        else:
            about = f"# {field.description}" if field.description else ""
            yield _beside(f"{indent}{name}: {_scalar(plain[name])}", about)


def _scalar(value: Any) -> str:
    """Return a value as YAML in one line."""
    if isinstance(value, str) and not value:
        return "''"
    if isinstance(value, float):
        value = float(value)
    text = yaml.safe_dump(
        dict(value) if isinstance(value, Mapping) else value,
        default_flow_style=True,
        width=float("inf"),
        allow_unicode=True,
        sort_keys=False,
    )
    return text.removesuffix("\n").removesuffix("\n...").strip()


def _beside(line: str, comment: str) -> str:
    if not comment:
        return line
    return f"{line:<{COMMENT_COLUMN}}  {' '.join(comment.split())}"

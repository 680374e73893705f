"""The command-line reference, generated from the typer application."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer
from pieces import code, paragraphs, table

from mottrack.cli import app

INTRODUCTION = """# Command line

`mottrack COMMAND --help` prints the same. An error that you can fix is one line and exit code 2;
exit code 3 means that some scene failed or a check found faults, and that the rest was done.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION]
    for name, command in commands():
        words = [_word(p) for p in command.params if p.param_type_name == "argument"]
        parts.append(f"## {name}\n\n{paragraphs(command.help)}")
        parts.append(f"```\n{' '.join([name, *words])} [OPTIONS]\n```\n")
        parts.append(table(("", "", "default", ""), [_row(p) for p in command.params]))
    return "\n".join(parts)


def commands() -> Iterator[tuple[str, Any]]:
    """Yield (name as typed, command) of every command, in the order of the help."""
    yield from _below("mottrack", typer.main.get_command(app))


def _below(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    below = getattr(command, "commands", None)
    if not below:
        yield name, command
    for word, child in (below or {}).items():
        yield from _below(f"{name} {word}", child)


def _word(argument: Any) -> str:
    name = argument.name.upper()
    return f"[{name}]..." if argument.nargs == -1 else name if argument.required else f"[{name}]"


def _row(parameter: Any) -> tuple[str, ...]:
    is_option = parameter.param_type_name == "option"
    names = [*parameter.opts, *parameter.secondary_opts] if is_option else [parameter.name.upper()]
    kind = "" if getattr(parameter, "is_flag", False) else _type(parameter)
    default = "required" if parameter.required else _default(parameter)
    return " ".join(map(code, names)), kind, code(default), parameter.help or ""


def _type(parameter: Any) -> str:
    annotation = parameter.type_descriptor.annotation
    choices = getattr(annotation, "__args__", ())
    if choices and all(isinstance(c, str) for c in choices):
        return " or ".join(choices)
    return getattr(annotation, "__name__", str(annotation)).lower()


def _default(parameter: Any) -> str:
    value = parameter.default
    return "" if value is None or value == () else str(value)

"""``mottrack list`` and ``mottrack config``: what can be named, and what a configuration says."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Mapping
from typing import Annotated

import typer

from mottrack.cli.arguments import Config, Sweep

CONFIGS = "configs"
LISTS = ("configs", "flows", "trackers", "datasets", "objects")


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("list")(list_names)
    app.command("config")(config)


def list_names(
    what: Annotated[str, typer.Argument(help=", ".join(LISTS), autocompletion=lambda: list(LISTS))],
) -> None:
    """List the shipped configurations, or the parts that a configuration can name.

    Example: mottrack list configs
    """
    from mottrack.core.errors import unknown_name

    if what not in LISTS:
        raise unknown_name("list", what, LISTS)
    names = _configs() if what == CONFIGS else _parts(what)
    width = max(map(len, names))
    for name, summary in names.items():
        typer.echo(_wrapped(f"{name:{width}}  {summary}", width + 2))


def config(config: Config, overrides: Sweep = None) -> None:
    """Print a configuration resolved: every key with its value and what it means.

    The output is a configuration file too. A sweep prints each of its variants.

    Example: mottrack config demo flow=icp tracker.preset=pillarflow
    """
    from mottrack.experiment.described import described
    from mottrack.experiment.experiment import load_experiments

    texts = [described(one) for one in load_experiments(config, overrides or [])]
    typer.echo("---\n".join(texts), nl=False)


def _configs() -> Mapping[str, str]:
    from mottrack.experiment.configs import shipped_configs, summary

    # the first sentence; what follows says how it is used
    return {name: summary(path).split(". ")[0] for name, path in shipped_configs().items()}


def _wrapped(line: str, indent: int) -> str:
    """Wrap a line for a terminal; in a file or a pipe a name stays one line."""
    if not sys.stdout.isatty():
        return line
    width = max(shutil.get_terminal_size().columns, 2 * indent)
    return textwrap.fill(line, width, subsequent_indent=" " * indent)


def _parts(what: str) -> Mapping[str, str]:
    from mottrack.experiment.tables import TABLES

    return {name: entry.summary for name, entry in TABLES[what].items()}

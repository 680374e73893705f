"""Arguments and options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

# 1 is an unexpected exception; typer ends with 2 for a wrong command line too
EXIT_USER_ERROR = 2
EXIT_SCENES_FAILED = 3


def _config_names() -> list[str]:
    """Complete the name of a shipped configuration."""
    from mottrack.experiment.configs import shipped_configs

    return list(shipped_configs())


Config = Annotated[
    str,
    typer.Argument(
        help="YAML file, or the name of a shipped one (mottrack list configs)",
        autocompletion=_config_names,
    ),
]
Overrides = Annotated[list[str] | None, typer.Argument(help="key=value ...")]
Sweep = Annotated[
    list[str] | None, typer.Argument(help="key=value ...; flow=zero,icp makes a sweep")
]
Workers = Annotated[
    int, typer.Option("--workers", min=0, help="number of processes; 0: one per core")
]
Baseline = Annotated[
    str | None, typer.Option("--baseline", help="baseline run (default: the first)")
]
Strict = Annotated[bool, typer.Option("--strict", help="warnings are errors")]
FinishedRun = Annotated[Path, typer.Argument(help="folder of a finished run")]
SceneName = Annotated[str | None, typer.Option("--scene", help="name (default: the first)")]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        help="run on Ray: ray (this machine), auto, HOST:PORT or ray://HOST:PORT",
    ),
]
Results = Annotated[
    str,
    typer.Option(
        "--results",
        help="on a cluster: driver (results are sent to it) or shared (--out is a folder that "
        "every node sees)",
    ),
]
ShardOf = Annotated[
    str | None,
    typer.Option("--shard", help="I/N: every N-th scene from number I on; then mottrack merge"),
]
CacheSize = Annotated[
    float, typer.Option("--cache-gb", min=0.0, help="flow fields kept between runs; 0: none")
]


@dataclass(frozen=True)
class Talk:
    """How much a command says."""

    quiet: bool = False
    """Nothing but the last sentence, warnings of failed scenes, and errors."""
    verbose: bool = False
    """A line for every scene that ends."""
    full: bool = False
    """Every table instead of the main figures."""


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="say only what was found, and errors")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="a line for every scene that ends")]
Full = Annotated[
    bool, typer.Option("--full", help="every table: classes, all metrics, all differences")
]


class FullHelpGroup(TyperGroup):
    """A group whose help gives the first sentence of every command, wrapped and never cut."""

    # typer brings its own click or imports the installed one, by its version: Any is either
    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands."""
        found = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        rows = [(name, _first(command.help or "")) for name, command in found if command]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _first(text: str) -> str:
    return " ".join(text.split("\n\n", 1)[0].split())

"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

# 1 is an unexpected exception; typer ends with 2 for a wrong command line too
EXIT_USER_ERROR = 2
EXIT_SCENES_FAILED = 3

Config = Annotated[str, typer.Argument(help="YAML file, or the name of a shipped one")]
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

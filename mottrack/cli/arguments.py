"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[str, typer.Argument(help="YAML file, or the name of one that is shipped")]
Overrides = Annotated[list[str] | None, typer.Argument(help="key=value ...")]
Sweep = Annotated[
    list[str] | None, typer.Argument(help="key=value ...; flow=zero,icp makes a sweep")
]
Workers = Annotated[int, typer.Option("--workers", min=0, help="processes; 0: one a core")]
Baseline = Annotated[
    str | None,
    typer.Option("--baseline", help="run that the others are compared with; the first one"),
]
Strict = Annotated[bool, typer.Option("--strict", help="warnings are errors")]
FinishedRun = Annotated[Path, typer.Argument(help="folder of a finished run")]
SceneName = Annotated[str | None, typer.Option("--scene", help="by default the first one")]

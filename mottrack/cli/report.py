"""``mottrack report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Baseline

Folder = Annotated[Path, typer.Argument(help="folder of a run or of a comparison")]


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("report")(report)


def report(
    folder: Folder,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", help="HTML file (default: report.html in the folder)")
    ] = None,
    max_mb: Annotated[
        float, typer.Option("--max-mb", min=0.0, help="size limit of the animated scenes, MB")
    ] = 15.0,  # report.page.MAX_MB, which would import the report
    baseline: Baseline = None,
) -> None:
    """Write the HTML report of a finished run or comparison, from its stored results.

    Example: mottrack report out/demo --baseline zero
    """
    from mottrack.report.page import write_report
    from mottrack.runs.comparison import load_comparison

    path = folder / "report.html" if out is None else out
    write_report(load_comparison(folder, baseline), path, max_mb=max_mb)
    typer.echo(f"report:  {path}")

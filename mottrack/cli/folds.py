"""`mottrack folds`: settings judged on scenes that took no part in choosing them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.printed_tables import print_tables


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("folds")(folds)


def folds(
    plan: Annotated[str, typer.Argument(help="file of the study, or a shipped one: recorded")],
    *,
    data: Annotated[Path, typer.Option(help="folder below which the study's data lie")],
    out: Annotated[Path, typer.Option(help="folder for the tables")],
) -> None:
    """Judge settings of a tracker over folds of scenes of several data sets and detectors.

    What the tracker receives is computed once. Each fold's settings are chosen on the other folds.

    Example: mottrack folds recorded --data path/to/data --out out/folds
    """
    from mottrack.core.errors import ConfigError, require_out_folder
    from mottrack.formats.text_table import write_tables
    from mottrack.studies.folds.plan import read_plan
    from mottrack.studies.folds.study import study
    from mottrack.studies.folds.tables import tables_of

    require_out_folder(out)
    wanted = read_plan(plan)
    try:
        outcome = study(wanted, data, lambda text: typer.echo(text, err=True))
    except ConfigError as error:
        raise ConfigError(f"{plan}: {error}") from error
    tables = tables_of(wanted, outcome)
    write_tables(tables, out)
    print_tables(tables)
    typer.echo(f"tables: {out}")

"""``mottrack convert``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("convert")(convert)


def convert(  # noqa: PLR0913
    dataset: Annotated[Path, typer.Argument(help="folder of the data set")],
    out: Annotated[Path, typer.Argument(help="new folder")],
    overrides: Annotated[
        list[str] | None, typer.Argument(help="settings of the reader: key=value ...")
    ] = None,
    *,
    to: Annotated[
        str,
        typer.Option(
            "--to", help="nuscenes, t4, truckscenes, kitti, argoverse2, folder or ros (mcap)"
        ),
    ],
    source: Annotated[
        str | None, typer.Option("--from", help="kind of data set (default: by its layout)")
    ] = None,
    version: Annotated[
        str | None, typer.Option(help="of nuscenes and truckscenes: v1.0-trainval or v1.0-mini")
    ] = None,
) -> None:
    """Convert a data set: sweeps, poses, true boxes, detections; report what the format loses.

    What is lost is measured: every scene is read back and compared.

    Example: mottrack convert path/to/kitti_tracking out/mcap --to ros 'dataset.scenes=["0000"]'
    """
    from mottrack.datasets.check import kind_of_folder
    from mottrack.datasets.convert import Target
    from mottrack.datasets.convert import convert as converted
    from mottrack.experiment.overrides import data_settings
    from mottrack.experiment.plugins import load_part

    settings = {
        "kind": source or kind_of_folder(dataset),
        "root": str(dataset),
        **data_settings(overrides or []),
    }
    opened = load_part("dataset", settings).make()
    target = Target(out, to, version)
    count = 0
    for scene in converted(opened, target, lambda s: load_part("dataset", dict(s)).make()):
        count += 1
        arrow = "" if scene.name == scene.source else f" -> {scene.name}"
        typer.echo(f"{scene.source}{arrow}")
        for loss in scene.losses:
            typer.echo(f"  lost or changed: {loss}")
    typer.echo(f"{out}: {count} scenes in {to} format")

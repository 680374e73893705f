"""`mottrack eval capabilities`: curves of what trackers can do."""

from __future__ import annotations

import typer

from mottrack.cli.tracked import (
    Bootstrap,
    Dataroot,
    DetectionFiles,
    Given,
    Kind,
    KittiTracks,
    Labels,
    Out,
    Runs,
    Split,
    Submissions,
    Version,
)


def capabilities(  # noqa: PLR0913
    runs: Runs = None,
    *,
    out: Out,
    dataroot: Dataroot = None,
    submission: Submissions = None,
    version: Version = "v1.0-trainval",
    labels: Labels = None,
    tracks: KittiTracks = None,
    kind: Kind = "Car",
    split: Split = "val",
    detections: DetectionFiles = None,
    bootstrap: Bootstrap = 400,
) -> None:
    """Draw identity over gaps, latency, neighbours, velocity errors, false boxes and time.

    Example: mottrack eval capabilities out/demo --out out/capabilities
    """
    from mottrack.eval.capabilities.curves import curves
    from mottrack.eval.capabilities.report import write_outputs
    from mottrack.eval.capabilities.tracking import of_scenes
    from mottrack.formats.text_table import aligned

    given = Given(
        runs, dataroot, submission, version, labels, tracks, kind, split, detections
    ).read()
    shown = {name: curves(of_scenes(scenes), bootstrap) for name, scenes in given.items()}
    for table in write_outputs(out, shown):
        lines = [[column.name for column in table.columns], *table.texts()]
        typer.echo(f"{table.title}\n{aligned(lines)}\n")
    typer.echo(f"picture: {out / 'capabilities.png'}")

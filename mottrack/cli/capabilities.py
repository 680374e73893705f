"""`mottrack eval capabilities`: curves of what trackers can do."""

from __future__ import annotations

import typer

from mottrack.cli.printed_tables import print_tables
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

    given = Given(
        runs, dataroot, submission, version, labels, tracks, kind, split, detections
    ).read()
    shown = {name: curves(of_scenes(scenes), bootstrap) for name, scenes in given.items()}
    print_tables(write_outputs(out, shown))
    typer.echo(f"picture: {out / 'capabilities.png'}")

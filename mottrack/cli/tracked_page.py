"""`mottrack eval report`: one page on tracks of any kind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.tracked import (
    Dataroot,
    DetectionFiles,
    Given,
    Kind,
    KittiTracks,
    Labels,
    Runs,
    Split,
    Submissions,
    Version,
)


def tracked_report(  # noqa: PLR0913
    runs: Runs = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="HTML file.")],
    dataroot: Dataroot = None,
    submission: Submissions = None,
    version: Version = "v1.0-trainval",
    labels: Labels = None,
    tracks: KittiTracks = None,
    kind: Kind = "Car",
    split: Split = "val",
    detections: DetectionFiles = None,
) -> None:
    """Write capability curves, slices, calibration and probable label errors as one page.

    Example: mottrack eval report --labels label_02 --tracks results --out out/tracks.html
    """
    from mottrack.report.tracked_page import write_tracked_page

    given = Given(runs, dataroot, submission, version, labels, tracks, kind, split, detections)
    write_tracked_page(given.read(), out)
    typer.echo(f"page: {out}")

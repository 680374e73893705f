"""`mottrack eval slices`, `calibration` and `label-errors`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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


def slices(  # noqa: PLR0913
    runs: Runs = None,
    *,
    out: Out,
    by: Annotated[
        str,
        typer.Option(
            help="Columns, separated by commas: class, range, speed, points, occlusion, scene, or "
            "one of --columns; by default all but scene."
        ),
    ] = "",
    columns: Annotated[
        Path | None,
        typer.Option(help="CSV file: scene, at will id and frame, and columns of your own."),
    ] = None,
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
    """Compute recall, precision, MOTA, switches and errors by any property of the boxes.

    Example: mottrack eval slices out/demo --by range,occlusion --out out/slices
    """
    from mottrack.eval.slices.own_columns import read_own_columns
    from mottrack.eval.slices.report import DEFAULT_COLUMNS, sliced, write_outputs

    given = Given(
        runs, dataroot, submission, version, labels, tracks, kind, split, detections
    ).read()
    chosen = [name.strip() for name in by.split(",")] if by else list(DEFAULT_COLUMNS)
    if columns is not None:
        own = read_own_columns(columns)
        given = {name: own.added_to(scenes) for name, scenes in given.items()}
        chosen += [name for name in own.values if not by]
    print_tables(write_outputs(out, sliced(given, chosen, bootstrap)))


def calibration(  # noqa: PLR0913
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
    bootstrap: Bootstrap = 400,
) -> None:
    """Compare the scores of tracks with how often they are right: reliability diagram and ECE.

    Example: mottrack eval calibration out/demo --out out/calibration
    """
    from mottrack.eval.paired import draw
    from mottrack.eval.slices.calibration import calibrations
    from mottrack.eval.slices.calibration_report import write_outputs

    given = Given(runs, dataroot, submission, version, labels, tracks, kind, split, None).read()
    found = {
        name: calibrations(scenes, draw(len(scenes.results), bootstrap))
        for name, scenes in given.items()
    }
    print_tables(write_outputs(out, found))
    if any(not isinstance(run, str) for run in found.values()):
        typer.echo(f"picture: {out / 'calibration.png'}")


def label_errors(  # noqa: PLR0913
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
) -> None:
    """List what detections, flow and tracks agree on and the labels deny: probable label errors.

    Example: mottrack eval label-errors out/demo --out out/label_errors
    """
    from mottrack.eval.label_errors.report import write_outputs
    from mottrack.eval.label_errors.suspects import suspects

    given = Given(
        runs, dataroot, submission, version, labels, tracks, kind, split, detections
    ).read()
    print_tables(write_outputs(out, {name: suspects(scenes) for name, scenes in given.items()}))

"""``mottrack synth``, ``mottrack check`` and ``mottrack submit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Strict, Workers
from mottrack.cli.warn import EXIT_FAULTS


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("synth")(synth)
    app.command("check")(check)
    app.command("submit")(submit)


def synth(  # noqa: PLR0913
    out: Annotated[Path, typer.Argument(help="new folder for the data set")],
    *,
    scenes: Annotated[int, typer.Option(min=1, help="number of scenes")] = 2,
    format_name: Annotated[
        str,
        typer.Option(
            "--format", help="nuscenes, t4, truckscenes, kitti, argoverse2, folder or ros (mcap)"
        ),
    ] = "nuscenes",
    seed: Annotated[int, typer.Option(min=0, help="seed of everything random")] = 0,
    duration_s: Annotated[
        float, typer.Option("--duration", min=0.2, max=120.0, help="seconds a scene")
    ] = 20.0,
    version: Annotated[
        str | None,
        typer.Option(help="v1.0-trainval (default) or v1.0-mini; nuscenes and truckscenes only"),
    ] = None,
) -> None:
    """Write the embedded world as a data set in a real format, with truth and detections.

    The nuscenes format is a rehearsal of the real one: bicycle racks, returns of the ego vehicle's
    body, a tilted LiDAR, velocities NaN where the detector gives none.

    Example: mottrack synth out/world --format kitti --scenes 2
    """
    from mottrack.datasets.synthetic import SyntheticConfig
    from mottrack.datasets.writers import FORMATS, write_synthetic

    world = SyntheticConfig(scenes=scenes, seed=seed, duration_s=duration_s)
    names = write_synthetic(out, format_name, world, version)
    typer.echo(f"{out}: {len(names)} scenes in {format_name} format ({names[0]} .. {names[-1]})")
    if FORMATS[format_name].detections:
        typer.echo(f"detections: {out / FORMATS[format_name].detections}")


def check(  # noqa: PLR0913
    dataset: Annotated[Path, typer.Argument(help="folder of the data set")],
    overrides: Annotated[
        list[str] | None, typer.Argument(help="settings of the reader: key=value ...")
    ] = None,
    *,
    format_name: Annotated[
        str | None, typer.Option("--format", help="kind of data set (default: by its layout)")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="read only every so many-th sweep")] = 1,
    workers: Workers = 0,
    strict: Strict = False,
) -> None:
    """Report what is missing, damaged, out of order or unlikely in a data set.

    The exit code is 3 if there is a fault; a warning is one if strict.

    Example: mottrack check path/to/kitti_tracking
    """
    from mottrack.core.processes import available_cores
    from mottrack.datasets.check import check_dataset, kind_of_folder
    from mottrack.experiment.overrides import data_settings
    from mottrack.experiment.plugins import load_part

    settings: dict[str, object] = {
        "kind": format_name or kind_of_folder(dataset),
        "root": str(dataset),
        **data_settings(overrides or []),
    }
    opened = load_part("dataset", settings).make()
    result = check_dataset(opened, every=every, workers=workers or available_cores())
    for line in result.lines():
        typer.echo(line)
    if result.findings or (strict and result.concerns):
        raise typer.Exit(EXIT_FAULTS)


def submit(
    run: Annotated[Path, typer.Argument(help="folder of a finished run on nuScenes")],
    *,
    out: Annotated[Path, typer.Option("--out", help="the submission, a JSON file")],
    root: Annotated[
        Path | None, typer.Option(help="the data set, to check that no sample is missing")
    ] = None,
    split: Annotated[
        str | None, typer.Option(help="the split that it is for (default: that of the run)")
    ] = None,
) -> None:
    """Write the tracks of a run as a nuScenes tracking submission.

    Example: mottrack submit out/val --root path/to/nuscenes --out submission.json
    """
    from mottrack.datasets.nuscenes.config import NuScenesConfig
    from mottrack.datasets.nuscenes.dataset import NuScenes
    from mottrack.datasets.nuscenes.submission import Samples, write_submission
    from mottrack.runs.tracks_out import StoredTracks

    stored = StoredTracks.of(run)
    wanted = split or stored.split
    tokens = None
    if root is not None:
        tokens = Samples(NuScenes(NuScenesConfig(root=root, split=wanted)).sample_tokens(), wanted)
    boxes = write_submission(out, stored.results, expected=tokens)
    scenes = len(stored.folder.scenes)
    typer.echo(f"{out}: {boxes} boxes in {scenes} scenes, for split {wanted}")

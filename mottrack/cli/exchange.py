"""``mottrack tracks``, ``import`` and ``compare-runs``: tracks of and for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from mottrack.cli.arguments import Baseline, FinishedRun


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("tracks")(tracks)
    app.command("import")(import_)
    app.command("compare-runs")(compare_runs)


def tracks(
    run: FinishedRun,
    *,
    format_name: Annotated[
        str, typer.Option("--format", help="nuscenes, kitti, mot, argoverse2, csv, parquet or mcap")
    ],
    out: Annotated[
        Path, typer.Option("--out", help="a file; for kitti, mot, argoverse2 and mcap a folder")
    ],
    root: Annotated[
        Path | None, typer.Option(help="the data set, where it does not lie as the run says")
    ] = None,
) -> None:
    """Write the tracks of a run in the format of another tool.

    Example: mottrack tracks out/ours --format kitti --out out/ours_kitti
    """
    from mottrack.runs.tracks_out import StoredTracks, write_tracks

    written = write_tracks(StoredTracks.of(run, root), format_name, out)
    files = "file" if written.files == 1 else "files"
    typer.echo(f"{out}: {written.boxes} boxes in {written.files} {files}")


def import_(  # noqa: PLR0913
    dataset: Annotated[Path, typer.Argument(help="folder of the data set")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(help="settings: dataset.KEY=value, scores.KEY=value, scenes=[...] ..."),
    ] = None,
    *,
    tracks: Annotated[
        list[Path],
        typer.Option("--tracks", help="file or folder of tracks; repeat for files of a class each"),
    ],
    format_name: Annotated[
        str,
        typer.Option(
            "--format", help="nuscenes, kitti, mot, argoverse2 or table (csv, Parquet, feather)"
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="folder for the run")],
    name: Annotated[str, typer.Option("--name", help="title of the run in tables")] = "",
    data: Annotated[
        str | None, typer.Option("--data", help="kind of data set (default: by its layout)")
    ] = None,
    boxes_in: Annotated[
        Literal["world", "ego"], typer.Option("--boxes-in", help="frame of the boxes of a table")
    ] = "world",
) -> None:
    """Make a run of the tracks of any tracker: report, player and comparison work on it.

    Example: mottrack import path/to/kitti --format kitti --tracks results/data_0 --out out/theirs
    """
    from mottrack.cli.finished import show_comparison
    from mottrack.datasets.check import kind_of_folder
    from mottrack.runs.comparison import score_runs
    from mottrack.runs.tracks_in import Import, import_tracks

    settings = _settings(overrides or [])
    kind = data or ("mot" if format_name == "mot" else kind_of_folder(dataset))
    given = {"kind": kind, "root": str(dataset), **settings.pop("dataset", {})}
    settings.setdefault("name", name or out.name)
    if kind == "mot":
        settings.setdefault("scores", {}).setdefault("match_by", "iou")
        settings["scores"].setdefault("match_iou", MOT_IOU)
    request = Import(tuple(tracks), format_name, given, settings, boxes_in)
    imported = import_tracks(request, out)
    show_comparison(score_runs((imported.run,), out))
    run = imported.run
    boxes = sum(len(run.folder.load(scene, flow=False).tracks) for scene in run.finished)
    typer.echo(f"imported: {boxes} boxes in {len(imported.run.finished)} scenes")
    if imported.absent:
        typer.echo(f"without tracks, left out: {', '.join(imported.absent)}")


MOT_IOU = 0.5
"""MOTChallenge's own."""


def compare_runs(
    runs: Annotated[
        list[Path], typer.Argument(help="folders of runs, or of comparisons for all runs in them")
    ],
    *,
    out: Annotated[Path, typer.Option("--out", help="folder for tables and report")],
    baseline: Baseline = None,
) -> None:
    """Compare stored runs, made on different days or imported, on the scenes they have in common.

    Example: mottrack compare-runs out/theirs out/ours --out out/compared
    """
    from mottrack.cli.finished import show_comparison
    from mottrack.runs.comparison import score_runs
    from mottrack.runs.differences import check_baseline
    from mottrack.runs.stored_runs import load_stored_runs

    stored = load_stored_runs(runs)
    check_baseline([run.experiment for run in stored.runs], baseline)
    show_comparison(score_runs(stored.runs, out, baseline))
    typer.echo(f"scenes in common: {len(stored.scenes)} ({', '.join(stored.scenes)})")
    for title, scenes in stored.alone.items():
        typer.echo(f"left out, only in {title}: {', '.join(scenes)}")
    for title, text in stored.rules.items():
        typer.echo(f"{title}: {text}")


def _settings(overrides: list[str]) -> dict[str, Any]:
    """Return settings as a tree."""
    from mottrack.core.errors import ConfigError
    from mottrack.experiment.overrides import parse_override, set_key

    tree: dict[str, Any] = {}
    for override in overrides:
        key, values = parse_override(override)
        if len(values) != 1:
            raise ConfigError(f"override '{override}' has several values; an import takes one")
        set_key(tree, key, values[0])
    return tree

"""`mottrack eval capabilities`: curves of what trackers can do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mottrack.eval.capabilities.tracking import Scene

Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Bootstrap = Annotated[int, typer.Option(min=2, help="Resamples of the intervals.")]


def capabilities(  # noqa: PLR0913
    runs: Annotated[
        list[Path] | None, typer.Argument(help="Finished runs; a folder of several gives all.")
    ] = None,
    *,
    out: Out,
    dataroot: Annotated[Path | None, typer.Option(help="nuScenes data of a submission.")] = None,
    submission: Annotated[
        list[Path] | None, typer.Option(help="nuScenes tracking submission; may be repeated.")
    ] = None,
    version: Annotated[str, typer.Option(help="Folder of the tables.")] = "v1.0-trainval",
    labels: Annotated[Path | None, typer.Option(help="Folder of KITTI labels.")] = None,
    tracks: Annotated[
        list[Path] | None, typer.Option(help="Folder of KITTI results; may be repeated.")
    ] = None,
    kind: Annotated[str, typer.Option("--class", help="KITTI class.")] = "Car",
    split: Annotated[str, typer.Option(help="Of nuScenes or KITTI, or a file of names.")] = "val",
    bootstrap: Bootstrap = 400,
) -> None:
    """Draw identity over gaps, latency, neighbours, velocity errors, false boxes and time.

    Example: mottrack eval capabilities out/demo --out out/capabilities
    """
    from mottrack.core.errors import InputError
    from mottrack.eval.capabilities.curves import curves
    from mottrack.eval.capabilities.report import write_outputs
    from mottrack.formats.text_table import aligned

    found: dict[str, list[Scene]] = _of_runs(runs or [])
    if dataroot is not None:
        found |= {p.stem: _of_submission(dataroot, version, split, p) for p in submission or []}
    if labels is not None:
        found |= {p.name: _of_kitti(labels, p, split, kind) for p in tracks or []}
    if not found:
        expected = "runs, --dataroot with --submission, or --labels with --tracks"
        raise InputError("arguments", "nothing to evaluate", expected)
    shown = {name: curves(scenes, bootstrap) for name, scenes in found.items()}
    for table in write_outputs(out, shown):
        lines = [[column.name for column in table.columns], *table.texts()]
        typer.echo(f"{table.title}\n{aligned(lines)}\n")
    typer.echo(f"picture: {out / 'capabilities.png'}")


def _of_runs(paths: list[Path]) -> dict[str, list[Scene]]:
    from mottrack.core.errors import ResultError, require_exists
    from mottrack.eval.capabilities.tracking import of_results
    from mottrack.experiment.experiment import load_experiments
    from mottrack.runs.run_folder import RunFolder

    found: dict[str, list[Scene]] = {}
    for path in paths:
        require_exists(path)
        folders = [path] if (path / "config.yaml").exists() else sorted(path.glob("*/config.yaml"))
        if not folders:
            raise ResultError(path, "content", "no config.yaml", "the folder of a run")
        for folder in (f if f.is_dir() else f.parent for f in folders):
            stored = RunFolder(folder)
            config = load_experiments(str(stored.config_file))[0].settings.scores
            found[folder.name] = of_results([stored.load(n) for n in stored.scenes], config)
    return found


def _of_submission(dataroot: Path, version: str, split: str, path: Path) -> list[Scene]:
    from mottrack.eval.capabilities.tracking import of_submission
    from mottrack.eval.nuscenes.command import Request, run

    evaluation = run(Request(dataroot, version, split, path))
    return of_submission(evaluation.prepared, evaluation.metrics)


def _of_kitti(labels: Path, tracks: Path, split: str, kind: str) -> list[Scene]:
    from mottrack.eval.capabilities.tracking import of_kitti
    from mottrack.eval.kitti.files import Folders, read_folders, sequences_of
    from mottrack.eval.kitti.matching import KittiRules

    folders = Folders(labels, tracks, sequences_of(split))
    pairs = read_folders(folders, KittiRules(kind=kind.lower()))
    return [of_kitti(pair.labels, pair.results, kind.lower()) for pair in pairs]

"""`mottrack eval sceneflow`: point-wise flow, of files or of any data set with tracks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from mottrack.cli.arguments import Sweep

if TYPE_CHECKING:
    from mottrack.eval.sceneflow.figures import SceneSums
    from mottrack.eval.sceneflow.sums import SceneFlowSums
    from mottrack.experiment.experiment import Experiment

Config = Annotated[
    str | None, typer.Argument(help="Experiment whose flow sources are evaluated; none: files.")
]


def sceneflow(  # noqa: PLR0913
    config: Config = None,
    overrides: Sweep = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")],
    truth: Annotated[
        Path | None, typer.Option(help="The challenge's annotation files: LOG/STAMP.feather.")
    ] = None,
    predictions: Annotated[
        list[Path] | None,
        typer.Option(help="The challenge's prediction files, folder or zip; may be repeated."),
    ] = None,
    write_files: Annotated[
        bool,
        typer.Option(
            "--write-files", help="Write the challenge's files, and the archive to hand in."
        ),
    ] = False,
    mask: Annotated[
        Path | None,
        typer.Option(help="The challenge's masks, folder or zip: which sweeps and points."),
    ] = None,
    bootstrap: Annotated[int, typer.Option(min=2, help="Resamples of the intervals.")] = 400,
) -> None:
    """Compute EPE, bucketed and three-way, accuracy and angle error of scene flow.

    Example: mottrack eval sceneflow demo flow=zero,icp --out out/flow
    """
    from mottrack.core.errors import InputError
    from mottrack.eval.sceneflow.report import format_tables, write_outputs

    if (config is None) == (truth is None) or (truth is None) == bool(predictions):
        expected = "a CONFIG, or --truth with --predictions"
        raise InputError("arguments", "neither or both", expected)
    if truth is not None:
        methods = dict(_of_files(truth, predictions or []))
    else:
        folder = out / "files" if write_files else None
        methods = dict(_of_experiments(str(config), overrides or [], folder, mask))
    typer.echo(format_tables(write_outputs(out, methods, bootstrap)))


def _of_files(truth: Path, predictions: list[Path]) -> Iterator[tuple[str, SceneSums]]:
    """Yield the sums of each set of predictions; a log is a scene."""
    from mottrack.eval.sceneflow.figures import SceneSums
    from mottrack.eval.sceneflow.files import all_points, annotated_pairs
    from mottrack.eval.sceneflow.sums import frame_sums, total

    logs = annotated_pairs(truth)
    for number, path in enumerate(predictions, 1):
        name = path.name if len(predictions) == 1 else f"{number} {path.name}"
        parts = [total([frame_sums(p) for p in all_points(truth, path, log)]) for log in logs]
        yield name, SceneSums(tuple(parts))


def _of_experiments(
    config: str, overrides: list[str], folder: Path | None, mask: Path | None
) -> Iterator[tuple[str, SceneSums]]:
    """Yield the sums of each flow source of an experiment; write the files on request."""
    from mottrack.eval.sceneflow.figures import SceneSums
    from mottrack.eval.sceneflow.files import pack_predictions
    from mottrack.experiment.experiment import load_experiments

    for experiment in load_experiments(config, overrides):
        place = folder and folder / experiment.title
        written: list[str] = []
        yield (
            experiment.title,
            SceneSums(tuple(_of_scenes(experiment, Files(place, mask, written)))),
        )
        if place is not None:
            archive = place / "predictions.zip"
            pack_predictions(place / "predictions", written, archive)
            typer.echo(f"{experiment.title}: {len(written)} files in {archive}")


class Files(NamedTuple):
    """The challenge's files around an evaluation."""

    folder: Path | None
    """Where to write annotations and predictions; None: nowhere."""
    mask: Path | None
    written: list[str]
    """Names of the predictions that were written."""


def _of_scenes(experiment: Experiment, files: Files) -> Iterator[SceneFlowSums]:
    from mottrack.core.errors import InputError
    from mottrack.eval.sceneflow.files import FileSet, write_annotation, write_prediction
    from mottrack.eval.sceneflow.sums import frame_sums, total
    from mottrack.pipeline.scene_flow import scene_flow_points

    dataset = experiment.dataset.make()
    folder = files.folder
    masks = None if files.mask is None else FileSet(files.mask).mask
    for name in experiment.settings.scenes or dataset.scene_names:
        found = scene_flow_points(experiment, dataset.scene(name), masks)
        if not found:
            expected = "two annotated frames with sweeps, or frames that the masks name"
            raise InputError(f"scene {name}", "no pair", expected)
        for sample in found:
            if folder is not None:
                file = f"{name}/{sample.stamp_ns}.feather"
                if sample.points.valid.any():
                    write_annotation(folder / "annotations", file, sample.points)
                write_prediction(folder / "predictions", file, sample.points)
                files.written.append(file)
        yield total([frame_sums(sample.points) for sample in found])

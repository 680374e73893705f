"""`mottrack eval`: official scores of result files."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from mottrack.cli.arguments import FullHelpGroup, Strict
from mottrack.cli.capabilities import capabilities
from mottrack.cli.sceneflow import sceneflow
from mottrack.cli.warn import exit_with_warnings, warn_of

group = typer.Typer(
    help="Evaluate result files by the official rules.",
    cls=FullHelpGroup,
    no_args_is_help=True,
    epilog="Example: mottrack eval kitti --labels label_02 --tracks results --out out/eval",
)

Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]


def register(app: typer.Typer) -> None:
    """Add the verbs to the application."""
    group.command()(sceneflow)
    group.command()(capabilities)
    app.add_typer(group, name="eval")


@group.command()
def nuscenes(  # noqa: PLR0913
    dataroot: Annotated[Path, typer.Option(help="Folder of the data set.")],
    submission: Annotated[Path, typer.Option(help="Tracking submission, official JSON.")],
    out: Out,
    version: Annotated[str, typer.Option(help="Folder of the tables.")] = "v1.0-trainval",
    split: Annotated[str, typer.Option(help="Official split, or a file of scene names.")] = "val",
    interpolation: Annotated[
        Literal["official", "fixed"],
        typer.Option(help="Gap filling: the devkit's swapped weights, or correct ones."),
    ] = "official",
    arithmetic: Annotated[
        Literal["recorded", "machine"],
        typer.Option(help="Rounding of distances: the same everywhere, or the devkit's here."),
    ] = "recorded",
    strict: Strict = False,
    picture: Annotated[bool, typer.Option(help="Draw the recall curves.")] = True,
    bootstrap: Annotated[
        int, typer.Option(min=0, help="Confidence intervals from so many resamples; 0: none.")
    ] = 0,
    compare: Annotated[
        Path | None, typer.Option(help="A second submission: test its differences to the first.")
    ] = None,
    error_classes: Annotated[
        bool, typer.Option("--error-classes", help="Count errors by kind, and what each costs.")
    ] = False,
    hota: Annotated[bool, typer.Option("--hota", help="HOTA and IDF1 beside AMOTA.")] = False,
) -> None:
    """Compute the nuScenes tracking metrics (AMOTA, ...), equal to the devkit's.

    The velocity error of the tracks by category comes with them.

    Example: mottrack eval nuscenes --dataroot D --submission tracks.json --out out/eval
    """
    from mottrack.eval.nuscenes import command
    from mottrack.eval.nuscenes.rules import Rules
    from mottrack.pipeline.submission_velocity import velocity_report

    rules = Rules(interpolation=interpolation, arithmetic=arithmetic)
    extras = command.Extras(picture, bootstrap, compare, error_classes, hota)
    request = command.Request(dataroot, version, split, submission, rules, strict)
    warned: list[str] = []

    def warn(text: str) -> None:
        typer.echo(text, err=True)
        warned.append(text)

    for text in command.evaluate(request, extras, out, warn):
        typer.echo(text)
    for text in velocity_report(request, compare, out):
        typer.echo(text)
    exit_with_warnings(warned)


@group.command()
def kitti(  # noqa: PLR0913
    labels: Annotated[Path, typer.Option(help="Folder of label files, one per sequence.")],
    tracks: Annotated[Path, typer.Option(help="Folder of result files, one per sequence.")],
    out: Out,
    split: Annotated[str, typer.Option(help="val, train, trainval, or sequences: 1,2.")] = "val",
    kind: Annotated[str, typer.Option("--class", help="Car, Pedestrian or Cyclist.")] = "Car",
    measure: Annotated[Literal["3d", "2d"], typer.Option(help="Overlap to match by.")] = "3d",
    iou: Annotated[
        float | None, typer.Option(min=0.01, max=1.0, help="Least overlap; 0.25 (3d), 0.5 (2d).")
    ] = None,
    strict: Strict = False,
) -> None:
    """Evaluate one class by the KITTI 3-D MOT protocol of AB3DMOT (sAMOTA, AMOTA, ...).

    Example: mottrack eval kitti --labels label_02 --tracks results --class Car --out out/eval
    """
    from mottrack.eval.kitti import files
    from mottrack.eval.kitti.matching import DEFAULT_IOU, KittiRules

    least = DEFAULT_IOU[measure] if iou is None else iou
    rules = KittiRules(kind=kind.lower(), measure=measure, min_iou=least)
    folders = files.Folders(labels, tracks, files.sequences_of(split))
    result, concerns = files.evaluate_folders(folders, rules)
    warn_of(concerns, strict=strict)
    files.write_outputs(out, [result])
    typer.echo(files.format_table([result]))
    exit_with_warnings(concerns)


@group.command()
def mot(
    truth: Annotated[list[Path], typer.Option(help="Ground truth file; repeat per sequence.")],
    tracks: Annotated[list[Path], typer.Option(help="Result file; repeat in the same order.")],
    out: Out,
    iou: Annotated[float, typer.Option(min=0.01, max=1.0, help="Least overlap of a match.")] = 0.5,
    strict: Strict = False,
) -> None:
    """Compute CLEAR, IDF1 and HOTA on MOTChallenge text files.

    Example: mottrack eval mot --truth gt.txt --tracks result.txt --out out/eval
    """
    from mottrack.core.errors import InputError
    from mottrack.eval import mot as evaluation

    if len(truth) != len(tracks):
        raise InputError("--tracks", f"given {len(tracks)} times", f"{len(truth)} as --truth")
    scored = {
        f"{number} {pair[0].parent.name}": evaluation.score_files(*pair, iou)
        for number, pair in enumerate(zip(truth, tracks, strict=True), 1)
    }
    concerns = [concern for one in scored.values() for concern in one.concerns]
    warn_of(concerns, strict=strict)
    scores = {name: one.scores for name, one in scored.items()}
    scores["all"] = evaluation.together(list(scores.values()))
    evaluation.write_outputs(out, scores)
    typer.echo(evaluation.format_table(scores))
    exit_with_warnings(concerns)

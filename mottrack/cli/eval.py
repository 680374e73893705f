"""`mottrack eval`: official scores of result files."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from mottrack.cli import eval_tracks
from mottrack.cli.arguments import FullHelpGroup, Strict
from mottrack.cli.sceneflow import sceneflow
from mottrack.cli.warn import exit_with_warnings, warn_of

group = typer.Typer(
    help="Evaluate result files by the official rules.",
    cls=FullHelpGroup,
    no_args_is_help=True,
    epilog="Example: mottrack eval kitti --labels label_02 --tracks results --out out/eval",
)

Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Bootstrap = Annotated[
    int, typer.Option(min=0, help="Confidence intervals from so many resamples; 0: none.")
]


def register(app: typer.Typer) -> None:
    """Add the verbs to the application."""
    group.command()(sceneflow)
    eval_tracks.register(group)
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
    velocity_error: Annotated[
        bool, typer.Option(help="Velocity error by category: a quarter of the time.")
    ] = True,
) -> None:
    """Compute the nuScenes tracking metrics (AMOTA, ...), equal to the devkit's.

    The velocity error of the tracks by category (paper, section V-B) comes with them.

    Example: mottrack eval nuscenes --dataroot D --submission tracks.json --out out/eval --hota
    """
    from mottrack.eval.nuscenes import command
    from mottrack.eval.nuscenes.rules import Rules

    rules = Rules(interpolation=interpolation, arithmetic=arithmetic)
    extras = command.Extras(picture, bootstrap, compare, error_classes, hota, velocity_error)
    request = command.Request(dataroot, version, split, submission, rules, strict)
    warned: list[str] = []

    def warn(text: str) -> None:
        typer.echo(text, err=True)
        warned.append(text)

    for text in command.evaluate(request, extras, out, warn):
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
    bootstrap: Bootstrap = 0,
    strict: Strict = False,
) -> None:
    """Evaluate one class by the KITTI 3-D MOT protocol of AB3DMOT (sAMOTA, AMOTA, ...).

    HOTA and IDF1 by KITTI's own rules come with them; with --measure 2d they are its server's.

    Example: mottrack eval kitti --labels label_02 --tracks results --out out/eval --bootstrap 400
    """
    from mottrack.eval.kitti import files
    from mottrack.eval.kitti.matching import DEFAULT_IOU, KittiRules

    least = DEFAULT_IOU[measure] if iou is None else iou
    rules = KittiRules(kind=kind.lower(), measure=measure, min_iou=least)
    folders = files.Folders(labels, tracks, files.sequences_of(split))
    result = files.evaluate_folders(folders, rules, bootstrap)
    warn_of(result.concerns, strict=strict)
    files.write_outputs(out, result)
    typer.echo(files.format_table(result))
    exit_with_warnings(result.concerns)


@group.command()
def mot(  # noqa: PLR0913
    truth: Annotated[list[Path], typer.Option(help="Ground truth file; repeat per sequence.")],
    tracks: Annotated[list[Path], typer.Option(help="Result file; repeat in the same order.")],
    out: Out,
    iou: Annotated[float, typer.Option(min=0.01, max=1.0, help="Least overlap of a match.")] = 0.5,
    bootstrap: Bootstrap = 0,
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
    intervals = evaluation.intervals(list(scores.values()), bootstrap) if bootstrap else {}
    scores["all"] = evaluation.together(list(scores.values()))
    evaluation.write_outputs(out, scores, intervals)
    typer.echo(evaluation.format_table(scores))
    if bootstrap:
        typer.echo(evaluation.format_intervals(scores["all"], intervals))
    exit_with_warnings(concerns)


@group.command()
def argoverse2(  # noqa: PLR0913
    split: Annotated[Path, typer.Option("--dataroot", help="Folder of the logs, as sensor/val.")],
    tracks: Annotated[Path, typer.Option(help="Feather file of the tracks of all logs.")],
    out: Out,
    max_range_m: Annotated[
        float, typer.Option("--max-range", min=1.0, help="Metres from the vehicle.")
    ] = 50.0,
    objective: Annotated[
        Literal["hota", "mota"], typer.Option(help="What the shown threshold is best for.")
    ] = "hota",
    bootstrap: Bootstrap = 0,
) -> None:
    """Compute Argoverse 2's tracking metrics (HOTA, MOTA, AMOTA), equal to its package's.

    Example: mottrack eval argoverse2 --dataroot sensor/val --tracks tracks.feather --out out/eval
    """
    from mottrack.eval.argoverse2.files import read_logs
    from mottrack.eval.argoverse2.metrics import evaluate
    from mottrack.eval.argoverse2.report import write_outputs
    from mottrack.eval.argoverse2.rules import Argoverse2Rules
    from mottrack.formats.text_table import aligned

    rules = Argoverse2Rules(max_range_m=max_range_m)
    metrics = evaluate(list(read_logs(split, tracks)), rules)
    table = write_outputs(out, metrics, rules, objective, bootstrap)
    typer.echo(f"{aligned([[c.name for c in table.columns], *table.texts()])}\n{table.note}")


@group.command()
def waymo(
    truth: Annotated[Path, typer.Option(help="Labels: Objects of Waymo's metrics.proto.")],
    tracks: Annotated[Path, typer.Option(help="Tracks: Objects of Waymo's metrics.proto.")],
    out: Out,
) -> None:
    """Compute Waymo's tracking metrics (MOTA, MOTP), equal to its official operation's.

    Example: mottrack eval waymo --truth gt.bin --tracks tracks.bin --out out/eval
    """
    from mottrack.eval.waymo.files import read_segments
    from mottrack.eval.waymo.metrics import evaluate
    from mottrack.eval.waymo.report import write_outputs
    from mottrack.formats.text_table import aligned

    table = write_outputs(out, evaluate(list(read_segments(truth, tracks))))
    typer.echo(f"{aligned([[c.name for c in table.columns], *table.texts()])}\n{table.note}")

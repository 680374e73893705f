"""`mottrack eval`: official scores of result files."""

from pathlib import Path
from typing import Annotated, Literal

import typer

group = typer.Typer(help="Scores of result files by the official rules.", no_args_is_help=True)

Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]


def register(app: typer.Typer) -> None:
    """Adds the verbs to the application."""
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
        typer.Option(help="Gap filling: the devkit's swapped weights, or the right ones."),
    ] = "official",
    strict: Annotated[bool, typer.Option("--strict", help="Warnings are errors.")] = False,
    picture: Annotated[bool, typer.Option(help="Draw the recall curves.")] = True,
) -> None:
    """The nuScenes tracking metrics (AMOTA, AMOTP, ...), equal to the devkit's."""
    from mottrack.eval.nuscenes import submission_run
    from mottrack.eval.nuscenes.rules import Rules
    from mottrack.eval.nuscenes.table import format_table

    rules = Rules(interpolation=interpolation)
    request = submission_run.Request(dataroot, version, split, submission, rules, strict)
    evaluation = submission_run.run(request)
    _report_problems([str(problem) for problem in evaluation.problems])
    submission_run.write(evaluation, out)
    if picture:
        from mottrack.eval.nuscenes.recall_curves import draw_recall_curves

        draw_recall_curves(evaluation.metrics, out / "recall_curves.png")
    typer.echo(format_table(evaluation.metrics))


def _report_problems(problems: list[str], shown: int = 10) -> None:
    for problem in problems[:shown]:
        typer.echo(problem, err=True)
    if len(problems) > shown:
        typer.echo(f"and {len(problems) - shown} more, see problems.json", err=True)

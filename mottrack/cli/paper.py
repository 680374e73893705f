"""``mottrack paper``: reproduction of the tables, figures and claims of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Workers

EXIT_SCENES_FAILED = 3

Root = Annotated[Path | None, typer.Option(help="folder of the data set; omitted if not given")]
Settings = Annotated[
    list[str] | None,
    typer.Argument(
        help="NAME.key=value: settings of a recorded data set, such as "
        "nuscenes.detections=FILE or kitti.velodyne_root=FOLDER"
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("paper")(paper)


def paper(  # noqa: PLR0913
    settings: Settings = None,
    *,
    out: Annotated[
        Path, typer.Option("--out", help="output folder; an interrupted run resumes in it")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="use few and short scenes")] = False,
    kitti: Root = None,
    nuscenes: Root = None,
    argoverse2: Root = None,
    ablation: Annotated[
        Path | None,
        typer.Option(help="folder of the weights for Table II: NAME/weights.safetensors"),
    ] = None,
    workers: Workers = 0,
) -> None:
    """Reproduce every table, figure and claim of the paper beside the published values."""
    from mottrack.paper.page import write_paper
    from mottrack.paper.plan import Request
    from mottrack.paper.results import run_studies
    from mottrack.paper.studies import studies
    from mottrack.runs.terminal import TerminalProgress
    from mottrack.runs.workers import available_cores

    roots = {"kitti": kitti, "nuscenes": nuscenes, "argoverse2": argoverse2}
    given = {name: root for name, root in roots.items() if root is not None}
    request = Request(out, quick, given, settings or (), ablation)
    wanted = studies(request)
    with TerminalProgress() as progress:
        results = run_studies(
            wanted, out / "runs", workers=workers or available_cores(), progress=progress
        )
    for text in write_paper(results, request):
        typer.echo(text)
    if results.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)

"""``mottrack paper``: the paper's tables, figures and claims, measured again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXIT_SCENES_FAILED = 3

Root = Annotated[Path | None, typer.Option(help="folder of the data set, if it shall take part")]
Boxes = Annotated[Path | None, typer.Option(help="its detection file: Table III needs one")]


def register(app: typer.Typer) -> None:
    """Adds the command of this module."""
    app.command("paper")(paper)


def paper(  # noqa: PLR0913
    *,
    out: Annotated[Path, typer.Option("--out", help="folder; an interrupted run goes on in it")],
    quick: Annotated[bool, typer.Option("--quick", help="few and short scenes")] = False,
    kitti: Root = None,
    nuscenes: Root = None,
    nuscenes_detections: Boxes = None,
    argoverse2: Root = None,
    argoverse2_detections: Boxes = None,
    ablation: Annotated[
        Path | None, typer.Option(help="folder of Table II's weights: NAME/weights.safetensors")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="processes; 0: one a core")] = 0,
) -> None:
    """Measure every table, figure and claim of the paper again, beside what it prints."""
    from mottrack.paper.page import write_paper
    from mottrack.paper.plan import Request, studies
    from mottrack.paper.results import run_studies
    from mottrack.pipeline.terminal import TerminalProgress
    from mottrack.pipeline.workers import available_cores

    roots = {"kitti": kitti, "nuscenes": nuscenes, "argoverse2": argoverse2}
    boxes = {"nuscenes": nuscenes_detections, "argoverse2": argoverse2_detections}
    request = Request(out, quick, _given(roots), _given(boxes), ablation)
    wanted = studies(request)
    with TerminalProgress() as progress:
        results = run_studies(
            wanted, out / "runs", workers=workers or available_cores(), progress=progress
        )
    for text in write_paper(results, request):
        typer.echo(text)
    if results.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)


def _given(paths: dict[str, Path | None]) -> dict[str, Path]:
    return {name: path for name, path in paths.items() if path is not None}

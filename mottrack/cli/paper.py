"""``mottrack paper``: reproduction of the paper's tables, figures and claims."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import (
    EXIT_SCENES_FAILED,
    CacheSize,
    Cluster,
    Results,
    ShardOf,
    Workers,
)
from mottrack.cli.execution import Where
from mottrack.cli.finished import show_shard

Root = Annotated[Path | None, typer.Option(help="folder of the data set, to include it")]
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
        Path, typer.Option("--out", help="folder for results; an interrupted run in it is resumed")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="few and short scenes")] = False,
    kitti: Root = None,
    nuscenes: Root = None,
    argoverse2: Root = None,
    ablation: Annotated[
        Path | None, typer.Option(help="folder with weights of Table II: NAME/weights.safetensors")
    ] = None,
    workers: Workers = 0,
    cluster: Cluster = None,
    results: Results = "driver",
    shard: ShardOf = None,
    cache_gb: CacheSize = 0.0,
) -> None:
    """Reproduce every table, figure and claim of the paper, beside the printed values.

    Example: mottrack paper --quick --out out/paper
    """
    from mottrack.paper.page import write_paper
    from mottrack.paper.plan import Request
    from mottrack.paper.results import execute, run_studies
    from mottrack.paper.studies import studies
    from mottrack.runs.progress import TerminalProgress

    roots = {"kitti": kitti, "nuscenes": nuscenes, "argoverse2": argoverse2}
    given = {name: root for name, root in roots.items() if root is not None}
    request = Request(out, quick, given, settings or (), ablation)
    wanted = studies(request)
    execution = Where(workers, cluster, results, shard, cache_gb).execution()
    runs = out / "runs"
    with TerminalProgress() as progress:
        if not execution.shard.whole:
            reports, _ = execute(wanted, runs, execution=execution, progress=progress)
        else:
            found = run_studies(wanted, runs, execution=execution, progress=progress)
    if not execution.shard.whole:
        show_shard(execution.shard, reports.values(), out)
        return
    for text in write_paper(found, request):
        typer.echo(text)
    if found.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)

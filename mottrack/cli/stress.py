"""`mottrack stress`: trackers under detections and flow that get worse."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Config, Sweep
from mottrack.cli.printed_tables import print_tables


def register(app: typer.Typer) -> None:
    """Add the verbs to the application."""
    app.command("stress")(stress)


def stress(
    config: Config,
    overrides: Sweep = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")],
    kinds: Annotated[
        str, typer.Option(help="Kinds of damage, separated by commas; by default all.")
    ] = "",
    bootstrap: Annotated[int, typer.Option(min=2, help="Resamples of the intervals.")] = 400,
) -> None:
    """Degrade detections and flow step by step and report where each tracker fails.

    Example: mottrack stress demo flow=zero tracker=kalman --kinds dropout,jitter --out out/stress
    """
    from mottrack.core.errors import require_out_folder, unknown_name
    from mottrack.experiment.experiment import load_experiments
    from mottrack.studies.stress.damage import DAMAGES
    from mottrack.studies.stress.report import write_outputs
    from mottrack.studies.stress.study import Plan, outcomes

    require_out_folder(out)
    chosen = [kind.strip() for kind in kinds.split(",")] if kinds else list(DAMAGES)
    for kind in chosen:
        if kind not in DAMAGES:
            raise unknown_name("--kinds", kind, DAMAGES)
    experiments = load_experiments(config, overrides or [])
    plan = Plan(chosen, bootstrap)
    found = list(outcomes(experiments, plan, lambda text: typer.echo(text, err=True)))
    print_tables(write_outputs(out, found))
    typer.echo(f"picture: {out / 'stress.png'}")

"""``mottrack run``, ``compare``, ``demo`` and ``list``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import EXIT_SCENES_FAILED, Baseline, Config, Sweep, Workers

Out = Annotated[
    Path, typer.Option("--out", help="folder for results; an interrupted run in it is resumed")
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("run")(run)
    app.command("compare")(compare)
    app.command("demo")(demo)
    app.command("list")(list_parts)


def run(config: Config, overrides: Sweep = None, *, out: Out, workers: Workers = 0) -> None:
    """Track every scene of an experiment and score the result; a sweep runs every combination.

    Example: mottrack run demo flow=icp dataset.scenes=1 --out out/first
    """
    _run(config, overrides or [], out, workers)


def compare(
    config: Config,
    overrides: Sweep = None,
    *,
    out: Out,
    workers: Workers = 0,
    baseline: Baseline = None,
) -> None:
    """Run every combination, score it and test which differences are significant.

    Example: mottrack compare demo flow=zero,icp tracker=kalman,fixed_lag --out out/compare
    """
    _run(config, overrides or [], out, workers, baseline)


def demo(
    *,
    out: Out = Path("out/demo"),
    workers: Workers = 0,
    quick: Annotated[bool, typer.Option("--quick", help="one scene of 4 s")] = False,
) -> None:
    """Compare flow sources on the embedded world, which needs no download, and write a report.

    Example: mottrack demo --quick
    """
    quick_overrides = ["dataset.scenes=1", "dataset.duration_s=4"] if quick else []
    _run("demo", quick_overrides, out, workers)


def list_parts(
    what: Annotated[str, typer.Argument(help="flows, trackers, datasets or objects")],
) -> None:
    """List the parts that a configuration can name.

    Example: mottrack list flows
    """
    from mottrack.core.errors import unknown_name
    from mottrack.experiment.plugins import PARTS

    tables = {kind.plural: kind.table for kind in PARTS.values()}
    if what not in tables:
        raise unknown_name("list", what, tables)
    width = max(map(len, tables[what]))
    for name, entry in tables[what].items():
        typer.echo(f"{name:{width}}  {entry.summary}")


def _run(
    config: str, overrides: list[str], out: Path, workers: int, baseline: str | None = None
) -> None:
    from mottrack.experiment.experiment import load_experiments
    from mottrack.formats.text_table import write_tables
    from mottrack.report.page import write_report
    from mottrack.runs.comparison import run_comparison
    from mottrack.runs.comparison_tables import comparison_tables
    from mottrack.runs.terminal import TerminalProgress, print_comparison

    experiments = load_experiments(config, overrides)
    with TerminalProgress() as progress:
        comparison = run_comparison(
            experiments, out, workers=workers, progress=progress, baseline=baseline
        )
    write_tables(comparison_tables(comparison), out / "tables")
    print_comparison(comparison)
    if any(run.finished for run in comparison.runs):
        write_report(comparison, out / "report.html")
        typer.echo(f"report:  {out / 'report.html'}")
    if comparison.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)

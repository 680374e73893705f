"""``mottrack run``, ``compare``, ``demo`` and ``list``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Baseline, Config, Sweep, Workers

EXIT_SCENES_FAILED = 3

Out = Annotated[Path, typer.Option("--out", help="folder for results; may hold an earlier part")]


def register(app: typer.Typer) -> None:
    """Adds the commands of this module."""
    app.command("run")(run)
    app.command("compare")(compare)
    app.command("demo")(demo)
    app.command("list")(list_parts)


def run(config: Config, overrides: Sweep = None, *, out: Out, workers: Workers = 0) -> None:
    """Track every scene of an experiment and score it; a sweep runs every combination."""
    _run(config, overrides or [], out, workers)


def compare(
    config: Config,
    overrides: Sweep = None,
    *,
    out: Out,
    workers: Workers = 0,
    baseline: Baseline = None,
) -> None:
    """Run several flow sources and trackers; say what each was worth, and what of it is real."""
    _run(config, overrides or [], out, workers, baseline)


def demo(
    *, out: Out = Path("out/demo"), workers: Workers = 0, quick: bool = typer.Option(False)
) -> None:
    """Compare flow sources on the embedded world, which needs no download, and write a report."""
    quick_overrides = ["dataset.scenes=1", "dataset.duration_s=4"] if quick else []
    _run("demo", quick_overrides, out, workers)


def list_parts(
    what: Annotated[str, typer.Argument(help="flows, trackers, datasets or objects")],
) -> None:
    """List the parts that a configuration can name."""
    from mottrack.core.errors import unknown_name
    from mottrack.experiment.catalogue import catalogue

    tables = catalogue()
    if what not in tables:
        raise unknown_name("list", what, tables)
    width = max(len(name) for name in tables[what])
    for name, summary in tables[what].items():
        typer.echo(f"{name:{width}}  {summary}")


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
    if any(run.report.finished for run in comparison.runs):
        write_report(comparison, out / "report.html")
        typer.echo(f"report:  {out / 'report.html'}")
    if comparison.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)

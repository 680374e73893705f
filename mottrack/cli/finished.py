"""What a command shows and writes when its scenes have been run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mottrack.cli.arguments import EXIT_SCENES_FAILED, Talk
from mottrack.cli.printed_tables import table_width

MAIN_FIGURES = Talk()
"""What is printed where nothing else is asked for."""

if TYPE_CHECKING:
    from mottrack.runs.comparison import Comparison
    from mottrack.runs.runner import RunReport
    from mottrack.runs.shard import Shard


def show_comparison(comparison: Comparison, talk: Talk = MAIN_FIGURES) -> None:
    """Write tables and report, print the main figures; exit with 3 where scenes have failed."""
    from mottrack.formats.text_table import write_tables
    from mottrack.report.page import write_report
    from mottrack.runs.comparison_tables import comparison_tables
    from mottrack.runs.conclusion import conclusion
    from mottrack.runs.terminal import closing_text, comparison_text

    write_tables(comparison_tables(comparison), comparison.out / "tables")
    if not talk.quiet:
        for text in comparison_text(comparison, table_width(), full=talk.full):
            typer.echo(text)
    if any(run.finished for run in comparison.runs):
        write_report(comparison, comparison.out / "report.html")
    brief = talk.quiet and not comparison.failed
    for line in [conclusion(comparison)] if brief else closing_text(comparison):
        typer.echo(line)
    if comparison.failed:
        raise typer.Exit(EXIT_SCENES_FAILED)


def show_shard(shard: Shard, reports: Iterable[RunReport], out: Path) -> None:
    """Print what became of a shard, whose figures wait for the others; exit with 3 on failures."""
    listed = list(reports)
    failed = {scene: why for report in listed for scene, why in report.failed.items()}
    for scene, why in failed.items():
        typer.echo(f"failed {scene}: {why}")
    finished = sum(len(report.finished) for report in listed)
    typer.echo(f"shard {shard}: {finished} results in {out}; join all shards with mottrack merge")
    if failed:
        raise typer.Exit(EXIT_SCENES_FAILED)

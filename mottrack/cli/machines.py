"""``mottrack merge`` and ``mottrack cache``: work that was spread over machines or runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Baseline, Full, Quiet, Talk

MB = 1e6  # bytes, decimal as disks are sold


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("merge")(merge)
    app.command("cache")(cache)


def merge(
    shards: Annotated[list[Path], typer.Argument(help="folders of --shard runs, in any order")],
    *,
    out: Annotated[Path, typer.Option("--out", help="folder for the joined results")],
    baseline: Baseline = None,
    full: Full = False,
    quiet: Quiet = False,
) -> None:
    """Join the shards of a run or comparison and score them; those of a paper are only joined.

    Example: mottrack merge out/1 out/2 out/3 --out out/all
    """
    from mottrack.cli.finished import show_comparison
    from mottrack.runs.comparison import score_runs, stored_run
    from mottrack.runs.merge import merge_shards
    from mottrack.runs.run_folder import RunFolder

    merged = merge_shards(shards, out)
    for text in merged.repeated:
        typer.echo(f"shard {text} is there more than once, with the same results", err=True)
    if any(len(path.parts) > 1 for path in merged.reports):  # a paper: runs/data set/study/variant
        typer.echo(f"joined {len(merged.reports)} runs; now: mottrack paper ... --out {out}")
        return
    runs = [
        stored_run(RunFolder(out / path), path.name, report)
        for path, report in merged.reports.items()
    ]
    show_comparison(score_runs(tuple(runs), out, baseline), Talk(quiet, full=full))


def cache(
    *, clear: Annotated[bool, typer.Option("--clear", help="remove every entry")] = False
) -> None:
    """Show the flow fields that --cache-gb keeps between runs, or remove them.

    Example: mottrack cache --clear
    """
    from mottrack.cli.execution import flow_cache

    kept = flow_cache(0.0)
    entries, size_mb = len(kept.entries), kept.size_bytes / MB
    if clear:
        kept.clear()
    verb = "removed" if clear else "kept"
    typer.echo(f"{kept.folder}: {verb} {entries} scenes of flow fields, {size_mb:.1f} MB")

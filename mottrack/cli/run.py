"""``mottrack run``, ``compare`` and ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import (
    Baseline,
    CacheSize,
    Cluster,
    Config,
    Full,
    Quiet,
    Results,
    ShardOf,
    Sweep,
    Talk,
    Verbose,
    Workers,
)
from mottrack.cli.execution import Where
from mottrack.cli.finished import show_comparison, show_shard

Out = Annotated[
    Path, typer.Option("--out", help="folder for results; an interrupted run in it is resumed")
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("run")(run)
    app.command("compare")(compare)
    app.command("demo")(demo)


def run(  # noqa: PLR0913
    config: Config,
    overrides: Sweep = None,
    *,
    out: Out,
    workers: Workers = 0,
    cluster: Cluster = None,
    results: Results = "driver",
    shard: ShardOf = None,
    cache_gb: CacheSize = 0.0,
    full: Full = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Track every scene of an experiment and score the result; a sweep runs every combination.

    Example: mottrack run demo flow=icp dataset.scenes=1 --out out/first
    """
    where = Where(workers, cluster, results, shard, cache_gb)
    _run(config, overrides or [], out, where, Talk(quiet, verbose, full))


def compare(  # noqa: PLR0913
    config: Config,
    overrides: Sweep = None,
    *,
    out: Out,
    workers: Workers = 0,
    baseline: Baseline = None,
    cluster: Cluster = None,
    results: Results = "driver",
    shard: ShardOf = None,
    cache_gb: CacheSize = 0.0,
    full: Full = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Run every combination, score it and test which differences are significant.

    Example: mottrack compare demo flow=zero,icp tracker=kalman,fixed_lag --out out/compare
    """
    where = Where(workers, cluster, results, shard, cache_gb)
    _run(config, overrides or [], out, where, Talk(quiet, verbose, full), baseline)


def demo(  # noqa: PLR0913
    *,
    out: Out = Path("out/demo"),
    workers: Workers = 0,
    quick: Annotated[bool, typer.Option("--quick", help="one scene of 4 s")] = False,
    full: Full = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare flow sources on the embedded world, which needs no download, and write a report.

    Example: mottrack demo --quick
    """
    quick_overrides = ["dataset.scenes=1", "dataset.duration_s=4"] if quick else []
    _run("demo_clusters", quick_overrides, out, Where(workers), Talk(quiet, verbose, full))


def _run(  # noqa: PLR0913
    config: str,
    overrides: list[str],
    out: Path,
    where: Where,
    talk: Talk,
    baseline: str | None = None,
) -> None:
    if not talk.quiet:  # before the libraries are loaded, which takes a second or more
        typer.echo(f"{config}: results in {out}")
    from mottrack.experiment.experiment import load_experiments
    from mottrack.runs.comparison import comparison_jobs, run_comparison
    from mottrack.runs.progress import TerminalProgress
    from mottrack.runs.runner import run_jobs

    experiments, execution = load_experiments(config, overrides), where.execution()
    with TerminalProgress(quiet=talk.quiet, each_scene=talk.verbose) as progress:
        if not execution.shard.whole:
            jobs = comparison_jobs(experiments, out)
            reports = run_jobs(jobs, execution=execution, progress=progress)
        else:
            comparison = run_comparison(
                experiments, out, execution=execution, progress=progress, baseline=baseline
            )
    if execution.shard.whole:
        show_comparison(comparison, talk)
    else:
        show_shard(execution.shard, reports, out)

"""The functions behind ``mottrack.run``, ``compare``, ``load`` and ``evaluate``.

They do what the commands of the same name do, and return objects that print as short texts and, in
a notebook, as tables and pictures.

Progress: scenes are run one after the other in this process, and a line on standard output tells
what is done and how long the rest takes: at the start, every five seconds, and at the end (a bar on
a terminal). ``quiet=True`` says nothing. ``workers=N`` spreads the scenes over N processes; a
program that asks for them needs the usual guard ``if __name__ == "__main__":``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mottrack.core.errors import ConfigError
from mottrack.core.result import SceneResult
from mottrack.eval.evaluation import score
from mottrack.eval.scores import ScoreConfig, Scores
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.comparison import Comparison, load_comparison, run_comparison
from mottrack.runs.here import Here
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.notebook import NotebookComparison
from mottrack.runs.progress import TerminalProgress
from mottrack.runs.runner import Execution
from mottrack.runs.scored_run import ScoredRun


def run(
    config: str, *overrides: str, out: Path | str, workers: int = 1, quiet: bool = False
) -> ScoredRun:
    """Track every scene of one experiment and score it, as ``mottrack run``.

    Args:
        config: path of a YAML file, or the name of a shipped one (``mottrack list configs``).
        overrides: ``key=value`` texts.
        out: folder for results; an interrupted run in it is resumed.
        workers: processes; 1: this one.
        quiet: whether no progress is told.

    Raises:
        ConfigError: a key, a name or a value is wrong, or the overrides make a sweep.
        DataError: a file can't be read.
    """
    found = load_experiments(config, overrides)
    if len(found) > 1:
        variants = ", ".join(experiment.variant for experiment in found)
        raise ConfigError(f"{len(found)} variants ({variants}), expected one: use mottrack.compare")
    return _run(config, overrides, Path(out), workers, quiet).runs[0]


def compare(
    config: str, *overrides: str, out: Path | str, workers: int = 1, quiet: bool = False
) -> Comparison:
    """Run every combination, score it and test the differences, as ``mottrack compare``.

    Args:
        config: path of a YAML file, or the name of a shipped one (``mottrack list configs``).
        overrides: ``key=value`` texts; ``flow=zero,icp`` makes a sweep. The first run is the
            baseline; `load` takes another one.
        out: folder for results; an interrupted comparison in it is resumed.
        workers: processes; 1: this one.
        quiet: whether no progress is told.

    Raises:
        ConfigError: a key, a name or a value is wrong.
        DataError: a file can't be read.
    """
    return _run(config, overrides, Path(out), workers, quiet)


def load(folder: Path | str, baseline: str | None = None) -> Comparison:
    """Read finished runs of a folder and score them anew, as ``mottrack report`` does.

    Args:
        folder: of one run, or of a comparison.
        baseline: title of the baseline run, or part of it; by default the first run.

    Raises:
        ConfigError: the folder does not exist, or holds no finished scene.
        ResultError: a stored result is damaged.
    """
    return NotebookComparison.of(load_comparison(Path(folder), baseline))


def evaluate(results: Iterable[SceneResult], config: ScoreConfig | None = None) -> Scores:
    """Score the results of scenes together: CLEAR, AMOTA, IDF1, HOTA, velocity and flow error.

    Args:
        results: of `mottrack.pipeline.scene_run.run_scene`, or `SceneResult.load`.
        config: how boxes are matched; by default within 2 m, class by class.
    """
    return score(list(results), config)


def _run(config: str, overrides: Sequence[str], out: Path, workers: int, quiet: bool) -> Comparison:
    execution = Execution(Here() if workers == 1 else LocalPool(workers))
    experiments = load_experiments(config, overrides)
    with TerminalProgress(quiet=quiet) as progress:
        done = run_comparison(experiments, out, execution=execution, progress=progress)
    return NotebookComparison.of(done)

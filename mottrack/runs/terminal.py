"""What a finished comparison prints: its tables, and one sentence of what was found."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from mottrack.core.printed import printable
from mottrack.formats.text_table import fitted
from mottrack.runs.comparison import Comparison
from mottrack.runs.comparison_tables import comparison_tables
from mottrack.runs.conclusion import conclusion
from mottrack.runs.criteria import unmet
from mottrack.runs.equal_runs import told
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.summary_tables import summary_tables
from mottrack.runs.velocity_bench import plain_words


def comparison_text(comparison: Comparison, width: int, *, full: bool = False) -> Iterator[str]:
    """Yield the main tables, or every table if ``full``, no line of them wider than ``width``."""
    runs = [run for run in comparison.runs if run.finished]
    if runs:
        yield textwrap.fill(heading(runs), width)
    for table in comparison_tables(comparison) if full else summary_tables(comparison):
        yield ""
        yield fitted(table, width)
    yield ""
    for run in runs if full else ():
        if run.latency is not None:
            yield printable(f"latency {run.title}: {run.latency.summary}")


def closing_text(comparison: Comparison) -> Iterator[str]:
    """Yield warnings, failures, files, what was found in one sentence, and what flow was worth."""
    for run in comparison.runs:
        for text in run.concerns if run.finished else ():
            yield printable(f"warning {run.title}: {text}")
    for text in told(comparison.runs, comparison.equal):
        yield printable(f"equal: {text}")
    for name, reason in comparison.failed.items():
        yield printable(f"failed {name}: {reason}")
    yield f"figures: {comparison.out / 'scores.json'}"
    if any(run.finished for run in comparison.runs):
        yield f"tables:  {comparison.out / 'tables'}"
        yield f"report:  {comparison.out / 'report.html'}"
    yield printable(conclusion(comparison))
    for text in (*unmet(comparison.judged), *plain_words(comparison.flow_values)):
        yield printable(text)


def heading(runs: Sequence[ScoredRun]) -> str:
    """Return the name of the experiment and what all its runs have in common."""
    return printable(f"{runs[0].experiment.name}: {in_common(runs)}")


def in_common(runs: Sequence[ScoredRun]) -> str:
    """Return the numbers of runs and scenes, and the parts that all runs have in common."""
    groups = ("dataset", "objects", "flow", "tracker")
    kinds = [{run.experiment.parts[k].kind for run in runs} for k in range(len(groups))]
    same = [f"{name} {one.pop()}" for name, one in zip(groups, kinds, strict=True) if len(one) == 1]
    scenes = len({scene for run in runs for scene in run.finished})
    counts = [f"{len(runs)} run{'s' if runs[1:] else ''}"]
    counts.append(f"{scenes} scene{'s' if scenes > 1 else ''}")
    return printable(", ".join([*counts, *same]))

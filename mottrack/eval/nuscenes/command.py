"""What `mottrack eval nuscenes` does: the evaluation, and what else is asked for."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes import submission_run
from mottrack.eval.nuscenes.submission_run import Evaluation, Request
from mottrack.eval.nuscenes.table import format_table
from mottrack.eval.nuscenes.validation import Problem
from mottrack.formats.strict_json import strict

DEFAULT_RESAMPLES = 1000
_SHOWN_PER_FIELD = 2


@dataclass(frozen=True, slots=True)
class Extras:
    """What is wanted besides the official figures."""

    picture: bool = True
    bootstrap: int = 0
    """Number of resamples; 0: none (with `compare`: DEFAULT_RESAMPLES)."""
    compare: Path | None = None
    """A second submission."""
    anatomy: bool = False
    hota: bool = False


def evaluate(
    request: Request, extras: Extras, out: Path, warn: Callable[[str], None]
) -> Iterator[str]:
    """Writes all files to `out` and yields the tables, one after the other.

    Raises SubmissionError with every problem of a submission before anything is computed.
    """
    evaluation = submission_run.run(request)
    for line in _digest(evaluation.problems):
        warn(line)
    submission_run.write(evaluation, out)
    yield format_table(evaluation.metrics)
    if extras.picture:
        from mottrack.eval.nuscenes.recall_curves import draw_recall_curves

        draw_recall_curves(evaluation.metrics, out / "recall_curves.png")
    if extras.hota:
        yield _hota(evaluation, out)
    if extras.anatomy:
        yield _anatomy(evaluation, request, out)
    yield from _significance(evaluation, request, extras, out)


def _digest(problems: list[Problem]) -> Iterator[str]:
    """The first problems of each field, and how many more there are."""
    counts = Counter(problem.field for problem in problems)
    for field, count in counts.items():
        listed = [str(problem) for problem in problems if problem.field == field]
        yield from listed[:_SHOWN_PER_FIELD]
        if count > _SHOWN_PER_FIELD:
            yield f"... and {count - _SHOWN_PER_FIELD} more of {field} (problems.json)"


def _hota(evaluation: Evaluation, out: Path) -> str:
    from mottrack.eval.nuscenes.identity_scores import format_identity, identity_scores

    figures = identity_scores(evaluation.prepared, evaluation.metrics)
    write_text(out / "hota.json", json.dumps(strict(figures), indent=2))
    return format_identity(figures)


def _anatomy(evaluation: Evaluation, request: Request, out: Path) -> str:
    from mottrack.eval.nuscenes.anatomy_report import as_plain, classify_errors, format_anatomy

    anatomy = classify_errors(evaluation.prepared, request.rules)
    write_text(out / "anatomy.json", json.dumps(strict(as_plain(anatomy)), indent=2))
    return format_anatomy(anatomy)


def _significance(
    evaluation: Evaluation, request: Request, extras: Extras, out: Path
) -> Iterator[str]:
    from mottrack.eval.nuscenes.significance_report import bootstrap_report, comparison_report

    if extras.bootstrap:
        yield bootstrap_report(evaluation.prepared, request.rules, extras.bootstrap, out)
    if extras.compare:
        other = submission_run.run(replace(request, submission=extras.compare))
        pair = (evaluation.prepared, other.prepared)
        resamples = extras.bootstrap or DEFAULT_RESAMPLES
        yield comparison_report(pair, request.rules, resamples, out)

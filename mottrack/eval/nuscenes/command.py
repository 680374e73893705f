"""The evaluation of a submission file, from reading to all files and tables that are asked for."""

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes.bodies import to_bodies
from mottrack.eval.nuscenes.boxes import Bodies, GroundTruth, Prepared
from mottrack.eval.nuscenes.clean_submission import CleanSubmission, read_clean
from mottrack.eval.nuscenes.groundtruth import cached_ground_truth
from mottrack.eval.nuscenes.metrics import Metrics, evaluate_prepared
from mottrack.eval.nuscenes.outputs import draw_recall_curves, format_table, write_outputs
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.resampling import differences, profiles, sampled_metrics
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.submission import (
    Submission,
    describe_samples,
    read_submission,
    to_boxes,
)
from mottrack.eval.nuscenes.submission_checks import Problem, raise_all, validate
from mottrack.eval.nuscenes.velocity import (
    SubmissionErrors,
    comparison_text,
    submission_errors,
    unknown_text,
    velocity_content,
    velocity_differences,
    velocity_text,
)
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, PairedDifference, Sampled, draw
from mottrack.formats.nuscenes_splits import resolve_split
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import aligned

SHOWN = ("amota", "amotp", "mota", "recall", "ids")
"""Metrics that the tables of intervals and differences print; the files hold all."""
ONE_SCENE = "only one scene: no confidence interval"
_SHOWN_PER_FIELD = 2
"""Warnings of each field that are printed; problems.json has all."""


@dataclass(frozen=True, slots=True)
class Request:
    """What to evaluate against what."""

    dataroot: Path
    version: str
    split: str
    """An official split, or a file with a scene name in each line."""
    submission: Path
    rules: Rules = field(default_factory=Rules)
    strict: bool = False
    """Whether a warning about the submission is an error."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The metrics, and the problems of the submission."""

    metrics: Metrics
    problems: list[Problem]
    meta: dict[str, Any]
    """Of the submission."""
    eval_time_s: float
    prepared: Prepared
    path: Path
    """The submission."""
    bodies: Bodies
    """Its boxes with their velocities."""
    truth: GroundTruth

    def velocity_errors(self) -> SubmissionErrors:
        """Return the velocity error of every box."""
        return submission_errors(self.path, self.bodies, self.truth)


def run(request: Request) -> Evaluation:
    """Evaluate a submission file.

    Raises:
        SubmissionError: with every problem of the file.
        DataError: the tables are not usable.
    """
    truth = ground_truth(request)
    clean = read_clean(request.submission, truth.samples, request.rules)
    read, problems = _Read(clean, []) if clean else _checked(request, truth)
    began = time.perf_counter()
    prepared = prepare(truth, read.boxes, request.rules)
    metrics = evaluate_prepared(prepared, request.rules)
    seconds = time.perf_counter() - began
    where = (request.submission, read.bodies, truth)
    return Evaluation(metrics, problems, read.meta, seconds, prepared, *where)


class _Read(NamedTuple):
    """The content of a submission, and what is wrong with it."""

    content: CleanSubmission
    problems: list[Problem]


def _checked(request: Request, truth: GroundTruth) -> _Read:
    """Return content and problems of a submission that is read box by box."""
    submission = read_submission(request.submission)
    problems = check(request, submission, truth)
    if any(problem.severity == "error" for problem in problems) or request.strict:
        raise_all(problems)
    boxes = to_boxes(submission, truth.samples, request.rules)
    bodies = to_bodies(submission, boxes, request.rules)
    return _Read(CleanSubmission(submission.meta, boxes, bodies), problems)


def ground_truth(request: Request) -> GroundTruth:
    """Return the ground truth of the split."""
    names = resolve_split(request.split)
    return cached_ground_truth(request.dataroot, request.version, names, request.rules)


def check(request: Request, submission: Submission, truth: GroundTruth) -> list[Problem]:
    """Return all problems of a submission, with the split that extra samples belong to."""
    problems = validate(submission, truth.samples, request.rules)
    expected = set(truth.samples.token.tolist())
    if extra := [token for token in submission.results if token not in expected]:
        origin = describe_samples(request.dataroot, request.version, extra)
        text = f"{len(extra)} samples are not in split {request.split}: {origin}"
        problems.insert(0, Problem("error", submission.path, "", -1, "results", text))
    return problems


def write(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Write all files of an evaluation; the list of problems only if there are any."""
    paths = write_outputs(folder, evaluation.metrics, evaluation.meta, evaluation.eval_time_s)
    if evaluation.problems:
        path = folder / "problems.json"
        write_text(path, json.dumps([str(p) for p in evaluation.problems], indent=2))
        paths.append(path)
    return paths


@dataclass(frozen=True, slots=True)
class Extras:
    """What is wanted besides the official metrics."""

    picture: bool = True
    bootstrap: int = 0
    """Number of resamples; 0: none (with `compare`: RESAMPLES)."""
    compare: Path | None = None
    """A second submission."""
    error_classes: bool = False
    hota: bool = False
    velocity: bool = True
    """The velocity error of the tracks: a quarter of the time of an evaluation."""


def evaluate(
    request: Request, extras: Extras, out: Path, warn: Callable[[str], None]
) -> Iterator[str]:
    """Write all files to `out` and yield the tables, one after the other.

    Raises:
        SubmissionError: with every problem of a submission, before anything is written.
    """
    evaluation = run(request)
    other = run(replace(request, submission=extras.compare)) if extras.compare else None
    for one in (evaluation, other) if other else (evaluation,):
        for line in _first_problems(one.problems):
            warn(line)
    write(evaluation, out)
    yield format_table(evaluation.metrics)
    if extras.velocity:
        yield from _velocity(evaluation, other, out)
    if extras.picture:
        draw_recall_curves(evaluation.metrics, out / "recall_curves.png")
    # what needs scipy, slow to import, is imported on request
    if extras.hota:
        from mottrack.eval.nuscenes.identity_scores import format_identity, identity_scores

        scores = identity_scores(evaluation.prepared, evaluation.metrics)
        write_text(out / "hota.json", json.dumps(strict(scores), indent=2))
        yield format_identity(scores)
    if extras.error_classes:
        from mottrack.eval.nuscenes.error_counts import as_plain, classify_errors, format_errors

        errors = classify_errors([evaluation.prepared], evaluation.metrics)
        write_text(out / "error_classes.json", json.dumps(strict(as_plain(errors)), indent=2))
        yield format_errors(errors)
    if extras.bootstrap or other:
        yield from _significance(evaluation, other, extras, out)


def _velocity(evaluation: Evaluation, other: Evaluation | None, out: Path) -> Iterator[str]:
    """Yield the paper's second metric, and that of a second submission beside it; write both."""
    classes = evaluation.metrics.rules.classes
    errors = evaluation.velocity_errors()
    rows = velocity_content(errors, classes)
    content: dict[str, Any] = {"velocity_error": rows}
    yield from velocity_text(errors, rows)
    if other is not None:
        others = other.velocity_errors()
        yield from unknown_text(others)
        found = velocity_differences(errors, others, classes)
        content["differences"] = [
            {"row": d.key.row, "metric": d.key.metric, **d.as_dict()} for d in found
        ]
        yield comparison_text(found)
    write_text(out / "velocity_error.json", json.dumps(strict(content), indent=1))


def _first_problems(problems: list[Problem]) -> Iterator[str]:
    """Yield the first problems of each field, and how many more there are."""
    counts = Counter(problem.field for problem in problems)
    for name, count in counts.items():
        listed = [str(problem) for problem in problems if problem.field == name]
        yield from listed[:_SHOWN_PER_FIELD]
        if count > _SHOWN_PER_FIELD:
            yield f"... and {count - _SHOWN_PER_FIELD} more of {name} (problems.json)"


def _significance(
    evaluation: Evaluation, other: Evaluation | None, extras: Extras, out: Path
) -> Iterator[str]:
    """Yield the intervals, and the differences to a second submission; write both as JSON."""
    scenes = evaluation.prepared.samples.scenes
    if scenes == 1:
        yield ONE_SCENE
        return
    weights = draw(scenes, extras.bootstrap or RESAMPLES)
    rules = evaluation.metrics.rules
    sampled = sampled_metrics(profiles(evaluation.prepared, rules), weights, rules)
    method = f"{CONFIDENCE:.0%} intervals, Student's t over {len(weights)} resamples"
    content = {"resamples": len(weights), "interpolation": rules.interpolation}
    if extras.bootstrap:
        plain = {k: {n: _as_dict(s) for n, s in row.items()} for k, row in sampled.items()}
        write_text(out / "bootstrap.json", json.dumps(strict(content | {"metrics": plain})))
        rows = {label: [_interval_text(row[n]) for n in SHOWN] for label, row in sampled.items()}
        yield f"{method} of {scenes} scenes\n{_table(rows)}"
    if other is not None:
        second = sampled_metrics(profiles(other.prepared, rules), weights, rules)
        found: dict[str, dict[str, PairedDifference]] = {label: {} for label in sampled}
        for difference in differences(sampled, second):
            found[difference.key.row][difference.key.metric] = difference
        plain = {label: {n: d.as_dict() for n, d in row.items()} for label, row in found.items()}
        write_text(out / "comparison.json", json.dumps(content | {"differences": plain}))
        rows = {label: [_difference_text(row[n]) for n in SHOWN] for label, row in found.items()}
        yield f"difference to the first submission, {method}; *: significant\n{_table(rows)}"


def _as_dict(metric: Sampled) -> dict[str, float]:
    """Return a metric with its interval as plain data."""
    low, high = metric.interval()
    scenes, undefined = np.count_nonzero(metric.present), np.count_nonzero(np.isnan(metric.draws))
    numbers = {"value": metric.value, "low": low, "high": high}
    return {**numbers, "scenes": int(scenes), "undefined_resamples": int(undefined)}


def _interval_text(metric: Sampled) -> str:
    low, high = metric.interval()
    return f"{metric.value:.3f} [{low:.3f}, {high:.3f}]"


def _difference_text(found: PairedDifference) -> str:
    mark = "*" if found.significant else " "
    return f"{found.difference:+.3f} [{found.low:+.3f}, {found.high:+.3f}]{mark}"


def _table(rows: dict[str, list[str]]) -> str:
    return aligned([["class", *SHOWN], *([label, *cells] for label, cells in rows.items())])

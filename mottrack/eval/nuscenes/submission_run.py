"""A submission file evaluated from end to end: read, checked, evaluated, written."""

import json
import time
from dataclasses import dataclass, field
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes.boxes import GroundTruth, Prepared
from mottrack.eval.nuscenes.cache import cached_ground_truth
from mottrack.eval.nuscenes.outputs import write_outputs
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.sample_splits import describe_samples
from mottrack.eval.nuscenes.submission import Submission, read_submission, to_boxes
from mottrack.eval.nuscenes.summary import Metrics, evaluate_prepared
from mottrack.eval.nuscenes.validation import Problem, require_valid, validate
from mottrack.formats.nuscenes_splits import resolve_split


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
    """Whether a warning about the submission is as bad as an error."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The figures, and what was noticed on the way."""

    metrics: Metrics
    problems: list[Problem]
    submission: Submission
    eval_time_s: float
    prepared: Prepared


def run(request: Request) -> Evaluation:
    """Evaluates a submission file.

    Raises SubmissionError with every problem of the file, DataError for unusable tables.
    """
    truth = ground_truth(request)
    submission = read_submission(request.submission)
    problems = check(request, submission, truth)
    require_valid(problems, strict=request.strict)
    began = time.perf_counter()
    prepared = prepare(truth, to_boxes(submission, truth.samples, request.rules), request.rules)
    metrics = evaluate_prepared(prepared, request.rules)
    seconds = time.perf_counter() - began
    return Evaluation(metrics, problems, submission, seconds, prepared)


def ground_truth(request: Request) -> GroundTruth:
    """The ground truth of the split."""
    names = resolve_split(request.split)
    return cached_ground_truth(request.dataroot, request.version, names, request.rules)


def check(request: Request, submission: Submission, truth: GroundTruth) -> list[Problem]:
    """All problems of a submission, with the split that extra samples belong to."""
    problems = validate(submission, truth.samples, request.rules)
    expected = set(truth.samples.token.tolist())
    if extra := [token for token in submission.results if token not in expected]:
        told = describe_samples(request.dataroot, request.version, extra)
        text = f"{len(extra)} samples are not in split {request.split}: {told}"
        problems.insert(0, Problem("error", submission.path, "", -1, "results", text))
    return problems


def write(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Writes all files of an evaluation; the list of problems only if there are any."""
    meta = evaluation.submission.meta
    paths = write_outputs(folder, evaluation.metrics, meta, evaluation.eval_time_s)
    if evaluation.problems:
        path = folder / "problems.json"
        write_text(path, json.dumps([str(p) for p in evaluation.problems], indent=2))
        paths.append(path)
    return paths

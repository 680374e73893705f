"""Everything that is wrong with a submission, found before anything is computed."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mottrack.core.errors import MottrackError
from mottrack.eval.nuscenes.boxes import Samples
from mottrack.eval.nuscenes.rules import MAX_BOXES_PER_SAMPLE, Rules
from mottrack.eval.nuscenes.submission import Box, Submission

Severity = Literal["error", "warning"]
VECTORS = {"translation": 3, "size": 3, "rotation": 4}
_NUMBERS: dict[str, tuple[int, ...]] = {
    "translation": (3,),
    "size": (3,),
    "rotation": (4,),
    "velocity": (2,),
    "tracking_score": (),
}
UNIT_TOLERANCE = 1e-3
FAR_FROM_EGO_M = 200.0
_LOOKED_AT = 3
"""Boxes of each sample that tell in which frame the submission is."""
_SHOWN = 20


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong."""

    severity: Severity
    file: Path
    sample: str
    """Sample token, "" where the problem is the file's."""
    box: int
    """Index of the box in its sample, -1 where the problem is the sample's."""
    field: str
    message: str

    def __str__(self) -> str:
        where = f"{self.file}"
        where += f": sample {self.sample}" if self.sample else ""
        where += f", box {self.box}" if self.box >= 0 else ""
        return f"{self.severity}: {where}: {self.field}: {self.message}"


class SubmissionError(MottrackError):
    """A submission cannot be evaluated; carries every problem."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        lines = [str(problem) for problem in problems[:_SHOWN]]
        if len(problems) > _SHOWN:
            kinds = Counter(problem.field for problem in problems)
            counts = ", ".join(f"{name} {count}" for name, count in kinds.most_common())
            lines.append(f"and {len(problems) - _SHOWN} more problems; all by field: {counts}")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type["SubmissionError"], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)


def validate(submission: Submission, samples: Samples, rules: Rules) -> list[Problem]:
    """All problems, errors first.

    What the official code refuses, or what leaves nothing to evaluate, is an error; what it takes
    without a word although it is hardly meant is a warning.
    """
    found = list(_check_samples(submission, samples))
    if not is_clean(submission.results, rules):
        found += _check_boxes(submission, rules)
    found += _check_tracks(submission, samples)
    found += _check_frame(submission, samples)
    return sorted(found, key=lambda problem: problem.severity != "error")


def is_clean(results: dict[str, list[Box]], rules: Rules) -> bool:
    """Whether no box has a problem of its own: all boxes at once, but without saying which.

    False where that cannot be told; then every box is looked at.
    """
    try:
        boxes = [box for sample in results.values() for box in sample]
        columns = {name: np.array([box[name] for box in boxes]) for name in _NUMBERS}
        names = {box["tracking_name"] for box in boxes}
        identities = {type(box["tracking_id"]) for box in boxes}
        home = all(b["sample_token"] == token for token, sample in results.items() for b in sample)
    except (KeyError, TypeError, ValueError):
        return False
    shapes = {name: (len(boxes), *tail) for name, tail in _NUMBERS.items()}
    if any(columns[name].shape != shapes[name] for name in _NUMBERS):
        return False
    numeric = all(column.dtype.kind in "fi" for column in columns.values())
    norm = np.linalg.norm(columns["rotation"], axis=1) if numeric else np.zeros(1)
    score = columns["tracking_score"]
    return bool(
        numeric
        and home
        and names <= set(rules.classes)
        and identities <= {str, int}
        and all(np.isfinite(columns[name]).all() for name in (*VECTORS, "tracking_score"))
        and not np.isinf(columns["velocity"]).any()
        and (columns["size"] > 0).all()
        and (np.abs(norm - 1.0) <= UNIT_TOLERANCE).all()
        and ((score >= 0.0) & (score <= 1.0)).all()
        and not any("num_pts" in box for box in boxes)
    )


def require_valid(problems: Sequence[Problem], *, strict: bool) -> None:
    """Raises SubmissionError if any problem is an error; `strict`: if there is any problem."""
    bad = [problem for problem in problems if strict or problem.severity == "error"]
    if bad:
        raise SubmissionError(bad)


def _check_samples(submission: Submission, samples: Samples) -> Iterator[Problem]:
    expected = set(samples.token.tolist())
    given = submission.results
    missing = [token for token in samples.token.tolist() if token not in given]
    extra = [token for token in given if token not in expected]
    scene_of = dict(zip(samples.token.tolist(), samples.scene_of_sample().tolist(), strict=True))
    for token in missing:
        scene = samples.scene_name[scene_of[token]]
        yield _of_sample(submission, token, "results", f"sample of {scene} is missing")
    for token in extra:
        yield _of_sample(submission, token, "results", "sample is not in the split")
    sizes: dict[str, Any] = dict(given)
    for token, boxes in sizes.items():
        if not isinstance(boxes, list):
            yield _of_sample(submission, token, "results", "is not a list of boxes")
        elif len(boxes) > MAX_BOXES_PER_SAMPLE:
            text = f"{len(boxes)} boxes, at most {MAX_BOXES_PER_SAMPLE} are allowed"
            yield _of_sample(submission, token, "results", text)
    if not any(given.values()):
        yield Problem("error", submission.path, "", -1, "results", "there is no box at all")


def _of_sample(
    submission: Submission, token: str, field: str, message: str, severity: Severity = "error"
) -> Problem:
    return Problem(severity, submission.path, token, -1, field, message)


def _boxes(submission: Submission) -> Iterator[tuple[str, int, Any]]:
    for token, boxes in submission.results.items():
        for index, box in enumerate(boxes if isinstance(boxes, list) else ()):
            yield token, index, box


def _check_boxes(submission: Submission, rules: Rules) -> Iterator[Problem]:
    for token, index, box in _boxes(submission):
        for severity, field, message in _box_problems(box, token, rules):
            yield Problem(severity, submission.path, token, index, field, message)


_Finding = tuple[Severity, str, str]


def _box_problems(box: Any, token: str, rules: Rules) -> Iterator[_Finding]:
    if not isinstance(box, dict):
        yield "error", "box", f"is {type(box).__name__}, not an object"
        return
    for check in _BOX_CHECKS:
        yield from check(box)
    if box.get("tracking_name") not in rules.classes:
        known = ", ".join(rules.classes)
        yield "error", "tracking_name", f"{box.get('tracking_name')!r} is none of {known}"
    if box.get("sample_token", token) != token:
        yield "warning", "sample_token", f"{box['sample_token']!r} is not the sample it is in"


def _vectors(box: Box) -> Iterator[_Finding]:
    for name, length in VECTORS.items():
        value = box.get(name)
        if not isinstance(value, list) or len(value) != length:
            yield "error", name, f"{value!r} is not a list of {length} numbers"
        elif not all(_is_finite(x) for x in value):
            yield "error", name, f"{value} has NaN, infinity or no number in it"


def _size(box: Box) -> Iterator[_Finding]:
    size = box.get("size", [])
    if _is_vector(size, 3) and min(size) <= 0:
        yield "warning", "size", f"{size} is not positive"


def _rotation(box: Box) -> Iterator[_Finding]:
    rotation = box.get("rotation", [])
    if not _is_vector(rotation, 4):
        return
    norm = math.hypot(*rotation)
    if norm == 0.0:
        yield "warning", "rotation", "the quaternion is zero"
    elif abs(norm - 1.0) > UNIT_TOLERANCE:
        yield "warning", "rotation", f"the quaternion's norm is {norm:.6g}, not 1"


def _score(box: Box) -> Iterator[_Finding]:
    if "tracking_score" not in box:
        yield "warning", "tracking_score", "is missing, the official code takes -1 for it"
    elif not _is_finite(box["tracking_score"]):
        yield "error", "tracking_score", f"{box['tracking_score']!r} is not a finite number"
    elif not 0.0 <= box["tracking_score"] <= 1.0:
        yield "warning", "tracking_score", f"{box['tracking_score']} is not in [0, 1]"


def _velocity(box: Box) -> Iterator[_Finding]:
    velocity = box.get("velocity")
    if not isinstance(velocity, list) or len(velocity) != 2:
        yield "error", "velocity", f"{velocity!r} is not a list of 2 numbers"
    elif any(isinstance(v, float) and math.isinf(v) for v in velocity):
        yield "error", "velocity", f"{velocity} has infinity in it"


def _identity(box: Box) -> Iterator[_Finding]:
    if not isinstance(box.get("tracking_id"), str | int):
        yield "error", "tracking_id", f"{box.get('tracking_id')!r} is no identity"
    points = box.get("num_pts", -1)
    if not isinstance(points, int) or isinstance(points, bool):
        yield "error", "num_pts", f"{points!r} is not an integer"
    elif points == 0:
        yield "warning", "num_pts", "is 0: the official code drops the box"


_BOX_CHECKS: tuple[Callable[[Box], Iterator[_Finding]], ...] = (
    _vectors, _size, _rotation, _score, _velocity, _identity,
)  # fmt: skip


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_vector(value: object, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(_is_finite(x) for x in value)


def _check_tracks(submission: Submission, samples: Samples) -> Iterator[Problem]:
    """Identities that are twice in a frame, and classes that change within a track."""
    tokens = samples.token.tolist()
    scene_of = dict(zip(tokens, samples.scene_of_sample().tolist(), strict=True))
    class_of: dict[tuple[int, Any], Any] = {}
    for token in tokens:
        boxes = submission.results.get(token)
        seen: set[Any] = set()
        for index, box in enumerate(boxes if isinstance(boxes, list) else ()):
            identity = box.get("tracking_id") if isinstance(box, dict) else None
            if not isinstance(identity, str | int):
                continue
            if identity in seen:
                text = f"{identity!r} is twice in the sample"
                yield Problem("warning", submission.path, token, index, "tracking_id", text)
            seen.add(identity)
            name = box.get("tracking_name")
            before = class_of.setdefault((scene_of[token], identity), name)
            if before != name:
                text = f"track {identity!r} changes from {before!r} to {name!r}"
                yield Problem("warning", submission.path, token, index, "tracking_name", text)
                class_of[scene_of[token], identity] = name


def _check_frame(submission: Submission, samples: Samples) -> Iterator[Problem]:
    """Boxes in ego instead of global coordinates: near the origin, and far from the vehicle."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    rows, centres = [], []
    for token, index, box in _boxes(submission):
        if index >= _LOOKED_AT:
            continue
        centre = box.get("translation") if isinstance(box, dict) else None
        if token in row_of and centre is not None and _is_vector(centre, 3):
            rows.append(row_of[token])
            centres.append(centre[:2])
    if not centres:
        return
    xy = np.array(centres, np.float64)
    from_ego = np.hypot(*(xy - samples.ego_xy_m[rows]).T)
    from_origin = np.hypot(*xy.T)
    if np.median(from_ego) > FAR_FROM_EGO_M and np.median(from_origin) < FAR_FROM_EGO_M:
        text = (
            f"boxes are {np.median(from_ego):.0f} m from the vehicle and "
            f"{np.median(from_origin):.0f} m from the origin (medians): "
            "ego instead of global coordinates"
        )
        yield Problem("error", submission.path, "", -1, "translation", text)

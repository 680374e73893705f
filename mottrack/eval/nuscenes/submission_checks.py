"""What is wrong with a tracking submission: every problem, before anything is computed."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeGuard

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.checks import MAX_PLACE_M
from mottrack.core.errors import MAX_PATH_SHOWN, MottrackError
from mottrack.core.printed import MAX_MESSAGE, printable, shown
from mottrack.eval.nuscenes.boxes import Samples
from mottrack.eval.nuscenes.rules import MAX_BOXES_PER_SAMPLE, Rules
from mottrack.eval.nuscenes.submission import Box, Submission
from mottrack.formats.checks import MAX_BOX_SIZE_M

Severity = Literal["error", "warning"]
# number of elements of each field in the official format
VECTORS = {"translation": 3, "size": 3, "rotation": 4}
_NUMBERS: dict[str, tuple[int, ...]] = {
    "translation": (3,),
    "size": (3,),
    "rotation": (4,),
    "velocity": (2,),
    "tracking_score": (),
}
MAX_NUMBER = {"translation": MAX_PLACE_M, "size": MAX_BOX_SIZE_M}
"""Metres; a quaternion's numbers are checked by its norm."""
MAX_VELOCITY_MPS = 100.0
"""Of each component: no road user is faster; displacements or other units are."""
UNIT_TOLERANCE = 1e-3
"""Of a quaternion's norm: what a file with four decimals keeps."""
FAR_FROM_EGO_M = 200.0
"""Farther than any LiDAR sees: such boxes are in another frame."""
FRAME_CHECK_BOXES = 3
"""Boxes of each sample that the check of the frame reads: their median is enough."""
_SHOWN = 20
"""Problems that an error message lists one by one: about a screen."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a submission."""

    severity: Severity
    file: Path
    sample: str
    """Sample token, "" where the problem is the file's."""
    box: int
    """Index of the box in its sample, -1 where the problem is the sample's."""
    field: str
    message: str

    def __str__(self) -> str:
        where = shown(self.file, MAX_PATH_SHOWN)
        where += f": sample {self.sample}" if self.sample else ""
        where += f", box {self.box}" if self.box >= 0 else ""
        text = f"{self.severity}: {where}: {self.field}: {self.message}"
        return printable(text, MAX_MESSAGE)


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
    """Return all problems, errors first.

    What the official code refuses, or what leaves nothing to evaluate, is an error; what it accepts
    silently although it is hardly intended is a warning.
    """
    found = list(_check_samples(submission, samples))
    if not is_clean(submission.results, rules):
        found += _check_boxes(submission, rules)
    found += _check_tracks(submission, samples)
    found += _check_frame(submission, samples)
    return sorted(found, key=lambda problem: problem.severity != "error")


def is_clean(results: dict[str, list[Box]], rules: Rules) -> bool:
    """Return whether no box has a problem of its own, from all boxes at once.

    False where that cannot be decided; then every box is checked by itself.
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
        and all((np.abs(columns[name]) <= most).all() for name, most in MAX_NUMBER.items())
        and not (np.abs(columns["velocity"]) > MAX_VELOCITY_MPS).any()
        and (columns["size"] > 0).all()
        and (np.abs(norm - 1.0) <= UNIT_TOLERANCE).all()
        and ((score >= 0.0) & (score <= 1.0)).all()
        and not any("num_pts" in box for box in boxes)
    )


def raise_all(problems: Sequence[Problem]) -> None:
    """Raise `SubmissionError` with all problems, warnings behind the errors; none: do nothing."""
    if problems:
        raise SubmissionError(problems)


def _check_samples(submission: Submission, samples: Samples) -> Iterator[Problem]:
    expected = set(samples.token.tolist())
    given = submission.results

    def error(token: str, message: str) -> Problem:
        return Problem("error", submission.path, token, -1, "results", message)

    for token, scene in zip(samples.token.tolist(), samples.scene_of_sample(), strict=True):
        if token not in given:
            yield error(token, f"sample of {samples.scene_name[scene]} is missing")
    yield from (error(t, "sample is not in the split") for t in given if t not in expected)
    listed = {token: len(boxes) for token, boxes in given.items() if isinstance(boxes, list)}
    yield from (error(token, "is not a list of boxes") for token in given if token not in listed)
    for token in (token for token, count in listed.items() if count > MAX_BOXES_PER_SAMPLE):
        text = f"{listed[token]} boxes, at most {MAX_BOXES_PER_SAMPLE} are allowed"
        yield error(token, text)
    if not any(given.values()):
        yield error("", "there is no box at all")


class _PlacedBox(NamedTuple):
    """A box of a submission and where it is."""

    sample: str
    number: int
    content: Any


def _boxes(submission: Submission) -> Iterator[_PlacedBox]:
    for token, boxes in submission.results.items():
        for index, box in enumerate(boxes if isinstance(boxes, list) else ()):
            yield _PlacedBox(token, index, box)


def _check_boxes(submission: Submission, rules: Rules) -> Iterator[Problem]:
    for token, index, box in _boxes(submission):
        for found in _box_problems(box, token, rules):
            yield Problem(found.severity, submission.path, token, index, found.field, found.message)


class _Finding(NamedTuple):
    """A problem of a box, before its place is known."""

    severity: Severity
    field: str
    message: str


def _box_problems(box: Any, token: str, rules: Rules) -> Iterator[_Finding]:
    if not isinstance(box, dict):
        yield _Finding("error", "box", f"is {type(box).__name__}, not an object")
        return
    for check in _BOX_CHECKS:
        yield from check(box)
    if box.get("tracking_name") not in rules.classes:
        known = ", ".join(rules.classes)
        yield _Finding("error", "tracking_name", f"{box.get('tracking_name')!r} is none of {known}")
    if "sample_token" not in box:
        yield _Finding("error", "sample_token", "is missing")
    elif box["sample_token"] != token:
        text = f"{shown(box['sample_token'])} is not the sample it is in"
        yield _Finding("warning", "sample_token", text)


def _vectors(box: Box) -> Iterator[_Finding]:
    for name, length in VECTORS.items():
        value = box.get(name)
        if not isinstance(value, list) or len(value) != length:
            yield _Finding("error", name, f"{shown(value)} is not a list of {length} numbers")
        elif not all(_is_finite(x) for x in value):
            yield _Finding("error", name, f"{shown(value)} has NaN, infinity or no number in it")
        elif max(map(abs, value)) > MAX_NUMBER.get(name, math.inf):
            text = f"{shown(value)} is not within {MAX_NUMBER[name]:g}"
            yield _Finding("error" if name == "translation" else "warning", name, text)


def _size(box: Box) -> Iterator[_Finding]:
    size = box.get("size", [])
    if _is_vector(size, 3) and min(size) <= 0:
        yield _Finding("warning", "size", f"{size} is not positive")


def _rotation(box: Box) -> Iterator[_Finding]:
    rotation = box.get("rotation", [])
    if not _is_vector(rotation, 4):
        return
    norm = math.hypot(*rotation)
    if norm == 0.0:
        yield _Finding("warning", "rotation", "the quaternion is zero")
    elif abs(norm - 1.0) > UNIT_TOLERANCE:
        yield _Finding("warning", "rotation", f"the quaternion's norm is {norm:.6g}, not 1")


def _score(box: Box) -> Iterator[_Finding]:
    if "tracking_score" not in box:
        yield _Finding("warning", "tracking_score", "is missing, the official code takes -1 for it")
    elif not _is_finite(box["tracking_score"]):
        yield _Finding(
            "error", "tracking_score", f"{box['tracking_score']!r} is not a finite number"
        )
    elif not 0.0 <= box["tracking_score"] <= 1.0:
        yield _Finding("warning", "tracking_score", f"{box['tracking_score']} is not in [0, 1]")


def _velocity(box: Box) -> Iterator[_Finding]:
    velocity = box.get("velocity")
    if not isinstance(velocity, list) or len(velocity) != 2:
        yield _Finding("error", "velocity", f"{shown(velocity)} is not a list of 2 numbers")
    elif not all(v is None or (_is_number(v) and not math.isinf(v)) for v in velocity):
        yield _Finding("error", "velocity", f"{shown(velocity)} has infinity or no number in it")
    elif max(abs(v or 0.0) for v in velocity) > MAX_VELOCITY_MPS:
        text = f"{shown(velocity)} is not within {MAX_VELOCITY_MPS:g} m/s"
        yield _Finding("warning", "velocity", text)


def _identity(box: Box) -> Iterator[_Finding]:
    identity = box.get("tracking_id")
    if not isinstance(identity, str | int) or isinstance(identity, bool):
        yield _Finding("error", "tracking_id", f"{box.get('tracking_id')!r} is no identity")
    points = box.get("num_pts", -1)
    if not isinstance(points, int) or isinstance(points, bool):
        yield _Finding("error", "num_pts", f"{points!r} is not an integer")
    elif points == 0:
        yield _Finding("warning", "num_pts", "is 0: the official code drops the box")


_BOX_CHECKS: tuple[Callable[[Box], Iterator[_Finding]], ...] = (
    _vectors, _size, _rotation, _score, _velocity, _identity,
)  # fmt: skip


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_finite(value: object) -> bool:
    return _is_number(value) and math.isfinite(value)


def _is_vector(value: object, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(_is_finite(x) for x in value)


def _check_tracks(submission: Submission, samples: Samples) -> Iterator[Problem]:
    """Find identities that are twice in a frame, and classes that change within a track."""
    tokens = samples.token.tolist()
    scene_of = dict(zip(tokens, samples.scene_of_sample().tolist(), strict=True))
    class_of: dict[tuple[int, Any], Any] = {}
    kind_of: dict[tuple[int, str], type] = {}
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
            kind = kind_of.setdefault((scene_of[token], str(identity)), type(identity))
            if kind is not type(identity):
                text = f"{identity!r} and {kind(identity)!r} are two tracks, expected one type"
                yield Problem("warning", submission.path, token, index, "tracking_id", text)
                kind_of[scene_of[token], str(identity)] = type(identity)
            name = box.get("tracking_name")
            before = class_of.setdefault((scene_of[token], identity), name)
            if before != name:
                text = f"track {identity!r} changes from {before!r} to {name!r}"
                yield Problem("warning", submission.path, token, index, "tracking_name", text)
                class_of[scene_of[token], identity] = name


def _check_frame(submission: Submission, samples: Samples) -> Iterator[Problem]:
    """Find boxes in ego instead of global coordinates: near the origin, far from the vehicle."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    rows, centres = [], []
    for token, index, box in _boxes(submission):
        if index >= FRAME_CHECK_BOXES:
            continue
        centre = box.get("translation") if isinstance(box, dict) else None
        if token in row_of and centre is not None and _is_vector(centre, 3):
            rows.append(row_of[token])
            centres.append(centre[:2])
    if not centres:
        return
    xy_m, ego_xy_m = np.array(centres, np.float64), samples.ego_xy_m[rows]
    if in_ego_frame(xy_m, ego_xy_m):
        text = (
            f"boxes are {np.median(np.hypot(*(xy_m - ego_xy_m).T)):.0f} m from the vehicle and "
            f"{np.median(np.hypot(*xy_m.T)):.0f} m from the origin (medians): "
            "ego instead of global coordinates"
        )
        yield Problem("error", submission.path, "", -1, "translation", text)


def in_ego_frame(xy_m: F64, ego_xy_m: F64) -> bool:
    """Return whether boxes are near the origin and far from the vehicle, by medians.

    Args:
        xy_m: (N, 2) centres of boxes, N at least 1.
        ego_xy_m: (N, 2) where the vehicle is in their samples.
    """
    from_ego_m = np.median(np.hypot(*(xy_m - ego_xy_m).T))
    return bool(from_ego_m > FAR_FROM_EGO_M and np.median(np.hypot(*xy_m.T)) < FAR_FROM_EGO_M)

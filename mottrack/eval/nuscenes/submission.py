"""A tracking submission in the official JSON format, read into arrays."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from mottrack.core.errors import DataError
from mottrack.eval.nuscenes.boxes import BoxTable, Samples
from mottrack.eval.nuscenes.rules import Rules

Box = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Submission:
    """The content of a submission file, unchecked: `validation` says what is wrong with it."""

    path: Path
    meta: dict[str, Any]
    results: dict[str, list[Box]]
    """Sample token to boxes."""


def read_submission(path: Path) -> Submission:
    """Reads the file; raises DataError where it is not of the form {"meta", "results"} at all."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise DataError(path, "submission", error.strerror, "a readable JSON file") from error
    content = _parse(path, text)
    parts = content if isinstance(content, dict) else {}
    for name in ("meta", "results"):
        if not isinstance(parts.get(name), dict):
            raise DataError(path, name, type(parts.get(name)).__name__, "an object")
    return Submission(path, parts["meta"], parts["results"])


def _parse(path: Path, text: bytes) -> Any:
    """The content of the file.

    The slow parser takes NaN and Infinity, which are not JSON but which Python writes.
    """
    try:
        return orjson.loads(text)
    except orjson.JSONDecodeError:
        try:
            return json.loads(text)
        except ValueError as error:
            raise DataError(path, "JSON", str(error), "a JSON file") from error


def to_boxes(submission: Submission, samples: Samples, rules: Rules) -> BoxTable:
    """The boxes as arrays, in the order of the file. Wants a submission without errors."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    label_of = {name: i for i, name in enumerate(rules.classes)}
    scene_of = samples.scene_of_sample().tolist()
    track_of: dict[tuple[int, str], int] = {}
    numbers: list[tuple[int, int, int, int]] = []
    floats: list[float] = []
    for token, boxes in submission.results.items():
        sample = row_of[token]
        scene = scene_of[sample]
        for box in boxes:
            track = track_of.setdefault((scene, box["tracking_id"]), len(track_of))
            label = label_of[box["tracking_name"]]
            numbers.append((sample, track, label, box.get("num_pts", -1)))
            floats += box["translation"]
            floats.append(box.get("tracking_score", -1.0))
    rows = np.array(numbers, np.int64).reshape(-1, 4)
    values = np.array(floats, np.float64).reshape(-1, 4)
    return BoxTable(
        sample=rows[:, 0].copy(),
        track=rows[:, 1].copy(),
        label=rows[:, 2].astype(np.int8),
        centre_m=np.ascontiguousarray(values[:, :3]),
        score=values[:, 3].copy(),
        num_points=rows[:, 3].copy(),
    )

"""A tracking submission in the official JSON format: read, turned into arrays."""

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.errors import DataError
from mottrack.eval.nuscenes.boxes import BoxTable, Samples
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.collector import collector_paused
from mottrack.formats.json_text import parse_json
from mottrack.formats.nuscenes_splits import best_split, splits_of
from mottrack.formats.nuscenes_tables import NuScenesTables
from mottrack.formats.table_stream import RecordFilter

Box = dict[str, Any]
_LISTS = re.compile(rb'"([^"\\]+)"\s*:\s*\[\s*\{')
"""The names of lists of objects: only samples are such."""


@dataclass(frozen=True, slots=True)
class Submission:
    """The content of a submission file, unchecked (see `validate`)."""

    path: Path
    meta: dict[str, Any]
    results: dict[str, list[Box]]
    """Sample token to boxes."""


def read_submission(path: Path) -> Submission:
    """Read the file.

    Raises:
        DataError: it is not of the form {"meta", "results"} at all.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise DataError(path, "submission", error.strerror, "a readable JSON file") from error
    with collector_paused():
        content = parse_json(path, text)
    parts = content if isinstance(content, dict) else {}
    for name in ("meta", "results"):
        if not isinstance(parts.get(name), dict):
            raise DataError(path, name, type(parts.get(name)).__name__, "an object")
    _refuse_repeated_samples(path, text, parts["results"])
    return Submission(path, parts["meta"], parts["results"])


def _refuse_repeated_samples(path: Path, text: bytes, results: dict[str, Any]) -> None:
    """Refuse a sample that is there twice: of two values of a key a JSON parser keeps the last."""
    boxes = sum(len(boxes) for boxes in results.values() if isinstance(boxes, list))
    if text.count(b'"tracking_id"') <= boxes:
        return  # all that the text holds is there
    names = _LISTS.findall(text)
    if len(set(names)) != len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        shown_name = twice.decode(errors="replace")
        raise DataError(path, f"results[{shown_name}]", "there twice", "each sample once")


def to_boxes(submission: Submission, samples: Samples, rules: Rules) -> BoxTable:
    """Return the boxes of a submission without errors as arrays, in the order of the file."""
    row_of = {token: row for row, token in enumerate(samples.token.tolist())}
    label_of = {name: i for i, name in enumerate(rules.classes)}
    scene_of = samples.scene_of_sample().tolist()
    track_of: dict[tuple[int, str], int] = {}
    numbers: list[list[int]] = []
    floats: list[float] = []
    for token, boxes in submission.results.items():
        sample = row_of[token]
        scene = scene_of[sample]
        for box in boxes:
            track = track_of.setdefault((scene, box["tracking_id"]), len(track_of))
            label = label_of[box["tracking_name"]]
            numbers.append([sample, track, label, box.get("num_pts", -1)])
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


def describe_samples(dataroot: Path, version: str, tokens: Collection[str]) -> str:
    """Return in words the official splits that the scenes of the samples are in."""
    wanted = set(tokens)
    tables = NuScenesTables(dataroot, version)
    samples = tables.rows("sample", RecordFilter({"token": wanted}))
    scene_of = {row["token"]: row["scene_token"] for row in samples}
    name_of = {row["token"]: row["name"] for row in tables.rows("scene")}
    scenes = Counter(name_of.get(scene, "an unknown scene") for scene in scene_of.values())
    parts = []
    if scenes:
        split = best_split(list(scenes))
        names = [split] if split else list(splits_of(scenes)) or ["no official split"]
        parts.append(f"{len(scene_of)} belong to {' and '.join(names)}")
    if unknown := len(wanted) - len(scene_of):
        parts.append(f"{unknown} to no sample of {version}")
    return ", ".join(parts)

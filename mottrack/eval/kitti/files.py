"""Evaluation of folders of files; the result as files and as a table."""

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import Mask
from mottrack.core.concerns import Concern
from mottrack.core.errors import DataError, InputError, unknown_name
from mottrack.core.storage import write_text
from mottrack.eval.kitti.boxes import KittiBoxes, read_boxes
from mottrack.eval.kitti.concerns import Files, concerns
from mottrack.eval.kitti.identity_scores import (
    IdentitySums,
    identity_intervals,
    identity_sums,
    total,
)
from mottrack.eval.kitti.levels import KittiMetrics, evaluate
from mottrack.eval.kitti.matching import CLASSES, NEIGHBOURS, SPLITS, KittiRules, prepare
from mottrack.eval.kitti.resampling import profile, resampled
from mottrack.eval.paired import CONFIDENCE, draw
from mottrack.formats.strict_json import strict
from mottrack.formats.text_rows import read_lines
from mottrack.formats.text_table import aligned

_PERCENT = ("samota", "amota", "amotp", "mota", "motp")
_COUNTS = ("ids", "frag", "fp", "fn")
_SHARES = ("mt", "ml")


@dataclass(frozen=True, slots=True)
class Folders:
    """Where labels and results are: one text file per sequence in each."""

    labels: Path
    tracks: Path
    sequences: tuple[str, ...]


def sequences_of(split: str) -> tuple[str, ...]:
    """Return the sequences of a split, of a comma-separated list, or of a file with one a line.

    Numbers of a list are filled up to four digits, as the files are named.
    """
    if split in SPLITS:
        return SPLITS[split]
    if Path(split).is_file():
        return tuple(" ".join(read_lines(Path(split))).split())
    names = tuple(name.strip().zfill(4) for name in split.split(",") if name.strip())
    if names and all(name.isdigit() for name in names):
        return names
    raise unknown_name("split", split, SPLITS)


class Evaluated(NamedTuple):
    """The metrics, and what of the files is hardly meant."""

    metrics: KittiMetrics
    identity: dict[str, IdentitySums]
    """HOTA and IDF1 of all tracks, and of those that reach the score of the best MOTA."""
    intervals: dict[str, dict[str, list[float]]]
    """Ends of the 95 % intervals over sequences by "levels" or a key of `identity` and metric."""
    concerns: tuple[Concern, ...]


ALL_TRACKS, BEST_MOTA = "all tracks", "best MOTA"
_IDENTITY = ("hota", "det_a", "ass_a", "loc_a", "idf1", "idp", "idr")


def evaluate_folders(folders: Folders, rules: KittiRules, resamples: int = 0) -> Evaluated:
    """Read all sequences and evaluate one class.

    Args:
        folders: where labels and results are.
        rules: the class and how it is matched.
        resamples: of the sequences, for intervals; 0 for none.

    Raises:
        DataError: a file is missing or malformed, or no label counts.
        ConfigError: the class is unknown.
    """
    pairs = read_folders(folders, rules)
    found = tuple(c for pair in pairs for c in concerns(pair, rules))
    prepared = [prepare(pair.labels, pair.results, rules) for pair in pairs]
    try:
        metrics = evaluate(prepared, rules)
    except InputError as error:
        raise DataError(folders.labels, error.field, error.value, error.expected) from error
    chosen = {ALL_TRACKS: -np.inf, BEST_MOTA: metrics.best.threshold}
    parts = {k: [identity_sums(p, rules, least) for p in pairs] for k, least in chosen.items()}
    intervals: dict[str, dict[str, list[float]]] = {}
    if resamples:
        weights = draw(len(pairs), resamples)
        profiles = [profile(sequence, rules) for sequence in prepared]
        levels = resampled(metrics, profiles, weights)
        intervals["levels"] = {n: list(s.interval()) for n, s in levels.items()}
        intervals |= {k: identity_intervals(sums, weights) for k, sums in parts.items()}
    identity = {name: total(sums) for name, sums in parts.items()}
    return Evaluated(metrics, identity, intervals, found)


def read_folders(folders: Folders, rules: KittiRules) -> list[Files]:
    """Return labels and results of every sequence.

    Raises:
        DataError: a file is missing or malformed.
        ConfigError: the class is unknown.
    """
    if rules.kind not in CLASSES:
        raise unknown_name("class", rules.kind, CLASSES)
    return [_read_pair(folders, name, rules) for name in folders.sequences]


def _read_pair(folders: Folders, sequence: str, rules: KittiRules) -> Files:
    paths = []
    for folder in (folders.labels, folders.tracks):
        if not folder.is_dir():
            raise DataError(folder, "folder", "missing", "a folder of KITTI tracking text files")
        paths.append(folder / f"{sequence}.txt")
    labels, results = (_read(path, rules) for path in paths)
    return Files(labels, results, *paths)


def _read(path: Path, rules: KittiRules) -> KittiBoxes:
    boxes = read_boxes(path)
    compared = np.isin(boxes.kind, (rules.kind, *NEIGHBOURS[rules.kind]))
    _refuse_repeated(path, boxes, compared & (boxes.id >= 0))
    negative = compared & (boxes.box[:, 3:6] < 0.0).any(axis=1)
    if rules.measure == "3d" and negative.any():
        row = int(np.argmax(negative))
        where = f"length, width, height of id {boxes.id[row]} in frame {boxes.frame[row]}"
        raise DataError(path, where, boxes.box[row, 3:6].tolist(), "at least 0 m for 3d overlap")
    return boxes


def _refuse_repeated(path: Path, boxes: KittiBoxes, among: Mask) -> None:
    """Refuse an identity that is twice in a frame: the official code does not score such files."""
    rows = boxes.select(among)
    keys, counts = np.unique(np.stack([rows.frame, rows.id]), axis=1, return_counts=True)
    if (counts > 1).any():
        frame, identity = keys[:, np.argmax(counts > 1)].tolist()
        raise DataError(path, f"id {identity}", f"twice in frame {frame}", "each id once a frame")


def write_outputs(folder: Path, evaluated: Evaluated) -> None:
    """Write kitti.json with every level and kitti.csv with one line."""
    identity = {name: sums.as_dict() for name, sums in evaluated.identity.items()}
    content = evaluated.metrics.as_dict()
    plain = content | {"identity": identity, "intervals": evaluated.intervals}
    write_text(folder / "kitti.json", json.dumps(strict(plain), indent=2, allow_nan=False))
    text = io.StringIO()
    columns = ["class", "measure", "min_iou", *_PERCENT, *_COUNTS, *_SHARES, "tp", "truth"]
    writer = csv.DictWriter(
        text, [*columns, *_IDENTITY], lineterminator="\n", extrasaction="ignore"
    )
    writer.writeheader()
    writer.writerow(content | identity[ALL_TRACKS])
    write_text(folder / "kitti.csv", text.getvalue())


def format_table(evaluated: Evaluated) -> str:
    """Return the columns of the published table, then HOTA and IDF1; shares in per cent."""
    row, rules = evaluated.metrics.as_dict(), evaluated.metrics.rules
    levels = evaluated.intervals.get("levels", {})
    shares = [_per_cent(row[name], levels.get(name)) for name in _PERCENT]
    counts = [str(row[name]) for name in _COUNTS]
    cells = [row["class"], *shares, *counts, *(_per_cent(row[n]) for n in _SHARES)]
    first = aligned([["class", *_PERCENT, *_COUNTS, *_SHARES], cells])
    lines = [["tracks", *_IDENTITY]]
    for name, sums in evaluated.identity.items():
        ends, figures = evaluated.intervals.get(name, {}), sums.as_dict()
        lines.append([name, *(_per_cent(figures[key], ends.get(key)) for key in _IDENTITY)])
    note = f"matched by {rules.measure} IoU of at least {rules.min_iou:g}; counts at the best MOTA"
    if levels:
        note += f"; in brackets {CONFIDENCE:.0%} intervals over sequences"
    return f"{first}\n\n{aligned(lines)}\n{note}"


def _per_cent(value: float, ends: list[float] | None = None) -> str:
    if ends is None or np.isnan(ends[0]):
        return f"{100 * value:.2f}"
    return f"{100 * value:.2f} [{100 * ends[0]:.2f}, {100 * ends[1]:.2f}]"

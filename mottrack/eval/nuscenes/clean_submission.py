"""A submission without any problem, read straight into columns.

Most submissions are without fault, and then no box need become a Python object: the text is cut
into one line a box, Arrow's JSON reader makes columns of it a block at a time, and every check of
`submission_checks.validate` is made on the columns. Where the text is not laid out as expected, a
value is of another kind, or a check fails, nothing is decided here: the caller reads the file box
by box (`submission.read_submission`), which names every problem with its place.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.json

from mottrack.core.arrays import F64, I64
from mottrack.eval.nuscenes.bodies import seen_from_above, sorted_bodies
from mottrack.eval.nuscenes.boxes import Bodies, BoxTable, Samples
from mottrack.eval.nuscenes.rules import MAX_BOXES_PER_SAMPLE, Rules
from mottrack.eval.nuscenes.submission_checks import (
    FRAME_CHECK_BOXES,
    MAX_NUMBER,
    MAX_VELOCITY_MPS,
    UNIT_TOLERANCE,
    VECTORS,
    in_ego_frame,
)
from mottrack.formats.table_columns import numbers_of

_BLOCK_BYTES = 2**23
"""Text that becomes columns at a time: some 30,000 boxes; small beside other memory."""
_LONGEST_SAMPLE_BYTES = 2**22
"""Room for a sample beyond a block: 500 boxes of 8 kB each."""
_RESULTS = re.compile(rb'"results"\s*:\s*\{')
_SAMPLE_END = re.compile(rb"\}\s*\]")
_BETWEEN_BOXES = re.compile(rb"\}\s*,\s*\{")
_ENTRY = rb'\s*"([^"\\]*)"\s*:\s*\[\s*'
_EMPTY = re.compile(_ENTRY + rb"\]\s*,?")
_HEAD = re.compile(rb"\s*,?((?:" + _ENTRY.replace(b"(", b"(?:") + rb"\]\s*,)*)" + _ENTRY)
_LAST = re.compile(rb"(?:\s*,?" + _ENTRY.replace(b"(", b"(?:") + rb"\])*")
_NUMBER = pa.float64()
_SCHEMA = pa.schema(
    [
        ("sample_token", pa.string()),
        *((name, pa.list_(_NUMBER)) for name in (*VECTORS, "velocity")),
        ("tracking_id", pa.string()),
        ("tracking_name", pa.string()),
        ("tracking_score", _NUMBER),
        ("num_pts", pa.int64()),
    ]
)


class UnclearError(Exception):
    """Something that is left to the reader of single boxes."""


@dataclass(frozen=True)
class CleanSubmission:
    """The content of a submission in which nothing is wrong."""

    meta: dict[str, Any]
    boxes: BoxTable
    bodies: Bodies
    """The same boxes, sorted by sample."""


def read_clean(path: Path, samples: Samples, rules: Rules) -> CleanSubmission | None:
    """Return the boxes of a file in its order; None where the file must be read box by box."""
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            return _Reader(samples, rules).read(text)
    except (OSError, ValueError, OverflowError, RecursionError, pa.ArrowException, UnclearError):
        return None


class _Block(NamedTuple):
    """Whole samples of the file as text."""

    tokens: list[str]
    """Sample of each run of boxes."""
    boxes: list[bytes]
    """Their boxes, a line each."""
    empty: list[str]
    """Samples without boxes among them."""
    end: int
    """Where it ends in the file."""


@dataclass
class _Reader:
    samples: Samples
    rules: Rules
    _tokens: list[str] = field(default_factory=list)
    _parts: list[dict[str, Any]] = field(default_factory=list)

    def read(self, text: mmap.mmap) -> CleanSubmission:
        """Read the whole file.

        Raises:
            UnclearError: anything is not as it should be.
        """
        begin = _RESULTS.search(text)
        if begin is None:
            raise UnclearError
        end, added = begin.end(), Future[None]()
        added.set_result(None)
        with ThreadPoolExecutor(1) as beside:  # Arrow parses a block while the next one is cut
            for block in _blocks(text, begin.end()):
                added.result()
                added, end = beside.submit(self._add, block), block.end
            added.result()
        meta = self._meta(text[: begin.start()], text[end:])
        boxes = self._table()
        return CleanSubmission(meta, boxes, self._bodies(boxes))

    def _meta(self, head: bytes, tail: bytes) -> dict[str, Any]:
        """Return the meta block; the rest of the file must be an object of exactly two parts."""
        entries = _LAST.match(tail)
        empties = entries.group() if entries else b""
        self._tokens += [t.decode() for t in _EMPTY.findall(empties)]
        content = orjson.loads(head + b'"results":{' + tail[len(empties) :])
        if set(content) != {"meta", "results"} or content["results"]:
            raise UnclearError
        if not isinstance(content["meta"], dict) or b'"results"' in tail:
            raise UnclearError
        meta: dict[str, Any] = content["meta"]
        return meta

    def _add(self, block: _Block) -> None:
        """Check a block and keep what is evaluated of it."""
        lines = b"\n".join(block.boxes)
        table = _parsed(lines)
        counts = np.array([boxes.count(b"\n") + 1 for boxes in block.boxes])
        if table.num_rows != counts.sum() or (counts > MAX_BOXES_PER_SAMPLE).any():
            raise UnclearError
        row_of = {token: row for row, token in enumerate(self.samples.token.tolist())}
        rows = [row_of.get(token, -1) for token in block.tokens]
        self._tokens += block.tokens + block.empty
        if min(rows) < 0 or table["num_pts"].null_count != table.num_rows:
            raise UnclearError
        # of Arrow's own comparison with a list the first step would be to import pandas
        said = table["sample_token"].combine_chunks().dictionary_encode()
        place = {token: k for k, token in enumerate(said.dictionary.to_pylist())}
        own = np.repeat([place.get(token, -1) for token in block.tokens], counts)
        if said.null_count or (numbers_of(said.indices, np.int32) != own).any():
            raise UnclearError
        self._parts.append(self._columns(table, np.repeat(rows, counts)))

    def _columns(self, table: pa.Table, sample: I64) -> dict[str, Any]:
        vectors = {name: _vectors(table[name], length) for name, length in VECTORS.items()}
        velocity_mps = _vectors(table["velocity"], 2)
        score = _numbers(table["tracking_score"])
        norm = np.linalg.norm(vectors["rotation"], axis=1)
        names = table["tracking_name"].combine_chunks().dictionary_encode()
        known = names.dictionary.to_pylist()
        fine = (
            (vectors["size"] > 0).all()
            and all((np.abs(vectors[name]) <= most).all() for name, most in MAX_NUMBER.items())
            and (np.abs(velocity_mps) <= MAX_VELOCITY_MPS).all()
            and (np.abs(norm - 1.0) <= UNIT_TOLERANCE).all()
            and ((score >= 0.0) & (score <= 1.0)).all()
            and set(known) <= set(self.rules.classes)
            and not table["tracking_id"].null_count
            and not names.null_count
        )
        if not fine:
            raise UnclearError
        label = np.array([self.rules.classes.index(name) for name in known], np.int8)
        return {
            "sample": sample,
            "label": label[numbers_of(names.indices, np.int32)],
            "centre_m": vectors["translation"],
            "score": score,
            "bev": seen_from_above(*(vectors[name] for name in VECTORS)),
            "velocity_mps": velocity_mps,
            "id": table["tracking_id"].combine_chunks(),
        }

    def _table(self) -> BoxTable:
        """Return all boxes; every sample is there once, every identity once a sample, of one class.

        Raises:
            UnclearError: otherwise, or where boxes seem to be in the vehicle's frame.
        """
        if sorted(self._tokens) != sorted(self.samples.token.tolist()) or not self._parts:
            raise UnclearError
        keys = ("sample", "label", "centre_m", "score")
        sample, label, centre_m, score = (
            np.concatenate([part[key] for part in self._parts]) for key in keys
        )
        ids = pa.chunked_array([part["id"] for part in self._parts]).combine_chunks()
        number = numbers_of(ids.dictionary_encode().indices, np.int32).astype(np.int64)
        scene = self.samples.scene_of_sample()[sample]
        track, first = _numbered(scene * (number.max() + 1) + number)
        if (label != label[first][track]).any() or _repeated(sample, track):
            raise UnclearError
        first_few = _index_within(sample) < FRAME_CHECK_BOXES
        if in_ego_frame(centre_m[first_few, :2], self.samples.ego_xy_m[sample[first_few]]):
            raise UnclearError
        unknown = np.full(len(sample), -1)
        return BoxTable(sample, track, label, centre_m, score, unknown)

    def _bodies(self, boxes: BoxTable) -> Bodies:
        bev, velocity_mps = (
            np.concatenate([part[key] for part in self._parts]) for key in ("bev", "velocity_mps")
        )
        return sorted_bodies(boxes, bev, velocity_mps, self.rules)


def _blocks(text: mmap.mmap, at: int) -> Iterator[_Block]:
    """Yield whole samples, about a block of them at a time."""
    while at < len(text):
        # slices of the map are copies: no more than a block is in memory
        piece = text[at : at + _BLOCK_BYTES + _LONGEST_SAMPLE_BYTES]
        ends = [m.end() for m in _SAMPLE_END.finditer(piece)]
        ends = [end for end in ends if end <= _BLOCK_BYTES] or ends[:1]
        if not ends:
            return
        at += ends[-1]
        yield _block(piece, ends, at)


def _block(piece: bytes, ends: list[int], end_in_file: int) -> _Block:
    block, begin = _Block([], [], [], end_in_file), 0
    for end in ends:
        head = _HEAD.match(piece, begin)
        if head is None:
            raise UnclearError
        # samples without boxes come before the one whose boxes these are
        block.empty.extend(token.decode() for token in _EMPTY.findall(head.group(1)))
        block.tokens.append(head.group(2).decode())
        body = piece[head.end() : end].rstrip(b"] \t\r\n").replace(b"\n", b" ")
        block.boxes.append(_BETWEEN_BOXES.sub(b"}\n{", body))
        begin = end
    return block


def _parsed(lines: bytes) -> pa.Table:
    return pyarrow.json.read_json(
        pa.BufferReader(lines),
        # one chunk: a second thread gains nothing beside the cutting of the text
        pyarrow.json.ReadOptions(use_threads=False, block_size=len(lines) + 1),
        pyarrow.json.ParseOptions(explicit_schema=_SCHEMA, unexpected_field_behavior="ignore"),
    )


def _numbers(values: Any) -> F64:
    """Return a column of numbers; none may be missing, and JSON has no infinite ones."""
    array = numbers_of(values.combine_chunks(), np.float64)
    if values.null_count or not np.isfinite(array).all():
        raise UnclearError
    return array


def _vectors(values: Any, length: int) -> F64:
    """Return a column of lists of numbers, (N, length)."""
    lists = values.combine_chunks()
    flat = lists.flatten()
    offsets = np.diff(numbers_of(lists.offsets, np.int32))
    if lists.null_count or flat.null_count or (offsets != length).any():
        raise UnclearError
    array = numbers_of(flat, np.float64).reshape(-1, length)
    if not np.isfinite(array).all():
        raise UnclearError
    return array


def _numbered(keys: I64) -> tuple[I64, I64]:
    """Return the number of each key by first appearance, and where each appears first."""
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rank[inverse], first[order]


def _repeated(sample: I64, track: I64) -> bool:
    keys = np.sort(sample * (track.max() + 1) + track)
    return bool((keys[1:] == keys[:-1]).any())


def _index_within(sample: I64) -> I64:
    """Return the place of each box in its sample, whose boxes follow each other."""
    starts = np.flatnonzero(np.r_[True, sample[1:] != sample[:-1]])
    return np.arange(len(sample)) - np.repeat(starts, np.diff(np.r_[starts, len(sample)]))

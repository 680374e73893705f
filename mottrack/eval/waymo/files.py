"""Waymo's own files of boxes: `Objects` messages of Protocol Buffers, one file a side.

Each object has its segment (`context_name`), time, type, identity, box in the vehicle's frame and
score; truth has the difficulty. The fields read are those of `label.proto` and `metrics.proto` of
the Waymo Open Dataset.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.errors import DataError, MottrackError
from mottrack.eval.waymo.boxes import TYPES, Segment, SegmentBoxes
from mottrack.formats.checks import MAX_BOX_RANGE_M, MAX_BOX_SIZE_M
from mottrack.formats.columns import Columns
from mottrack.formats.files import read_bytes

_SIDES = ("x", "y", "z", "length", "width", "height", "heading")
_PROTO = {
    "Box": {
        "center_x": (1, "DOUBLE"),
        "center_y": (2, "DOUBLE"),
        "center_z": (3, "DOUBLE"),
        "width": (4, "DOUBLE"),
        "length": (5, "DOUBLE"),
        "height": (6, "DOUBLE"),
        "heading": (7, "DOUBLE"),
    },
    "Label": {
        "box": (1, "Box"),
        "type": (3, "INT32"),
        "id": (4, "STRING"),
        "tracking_difficulty_level": (6, "INT32"),
    },
    "Object": {
        "object": (1, "Label"),
        "score": (2, "FLOAT"),
        "overlap_with_nlz": (3, "BOOL"),
        "context_name": (4, "STRING"),
        "frame_timestamp_micros": (5, "INT64"),
    },
    "Objects": {"objects": (1, "[]Object")},
}
"""Number and type of each field; others are skipped."""


class MissingLibraryError(MottrackError):
    """The extra `waymo` is not installed."""


@cache
def _messages() -> Any:
    """Return the class of `Objects`."""
    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    except ImportError as error:
        hint = "Waymo's files need the package protobuf: pip install 'mottrack[waymo]'"
        raise MissingLibraryError(hint) from error
    file = descriptor_pb2.FileDescriptorProto(name="mottrack_waymo.proto", package="mottrack.waymo")
    kinds = descriptor_pb2.FieldDescriptorProto
    for name, fields in _PROTO.items():
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            repeated, kind = kind.startswith("[]"), kind.removeprefix("[]")
            label = kinds.LABEL_REPEATED if repeated else kinds.LABEL_OPTIONAL
            own = kind in _PROTO
            which = kinds.TYPE_MESSAGE if own else getattr(kinds, f"TYPE_{kind}")
            made = message.field.add(name=field, number=number, type=which, label=label)
            if own:
                made.type_name = f".mottrack.waymo.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("mottrack.waymo.Objects"))


def read_objects(path: Path, *, truth: bool) -> Columns:
    """Return the objects of a file that are evaluated, in its order.

    Args:
        path: the file.
        truth: whether it holds the labels: then there is no score.

    Raises:
        DataError: not such a file, or a value out of range.
        MissingLibraryError: protobuf is not installed.
    """
    messages = _messages()
    from google.protobuf.message import DecodeError

    try:
        objects = messages.FromString(read_bytes(path)).objects
    except (DecodeError, UnicodeDecodeError) as error:
        expected = "Objects of the Waymo Open Dataset (metrics.proto)"
        raise DataError(path, "content", f"unreadable ({error})", expected) from error
    if not len(objects):
        raise DataError(path, "objects", 0, "at least one")
    arrays = {
        "context_name": np.array([o.context_name for o in objects], np.str_),
        "frame_timestamp_micros": np.array([o.frame_timestamp_micros for o in objects], np.int64),
        "type": np.array([o.object.type for o in objects], np.int64),
        "id": np.array([o.object.id for o in objects], np.str_),
        "box": np.array([_box(o.object.box) for o in objects]),
        "score": np.array([0.0 if truth else o.score for o in objects]),
        "level": np.array([o.object.tracking_difficulty_level for o in objects], np.int64),
        "ignored": np.array([o.overlap_with_nlz and not truth for o in objects], np.bool_),
    }
    return _checked(Columns(path, arrays, np.arange(len(objects)), _place))


def _place(name: str, row: int) -> str:
    return f"{name} of object {row}"


def _box(box: Any) -> tuple[float, ...]:
    place = (box.center_x, box.center_y, box.center_z)
    return (*place, box.length, box.width, box.height, box.heading)


def _checked(table: Columns) -> Columns:
    for name in ("context_name", "id"):
        table.refuse(name, table[name] == "", "a name")
    known = (table["type"] >= 0) & (table["type"] <= len(TYPES))
    table.refuse("type", ~known, f"0 .. {len(TYPES)}")
    box = table["box"]
    table.refuse("box", ~np.isfinite(box).all(axis=1), f"finite {', '.join(_SIDES)}")
    table.refuse("box", np.abs(box[:, :3]) > MAX_BOX_RANGE_M, f"within {MAX_BOX_RANGE_M:g} m")
    size = (box[:, 3:6] < 0.0) | (box[:, 3:6] > MAX_BOX_SIZE_M)
    table.refuse("box", size, f"sides of 0 to {MAX_BOX_SIZE_M:g} m")
    table.refuse("score", ~((table["score"] >= 0.0) & (table["score"] <= 1.0)), "in [0, 1]")
    keys = [np.unique(table[n], return_inverse=True)[1] for n in ("context_name", "id")]
    keys.append(table["frame_timestamp_micros"])
    table.refuse_repeated("id", np.column_stack(keys), "each identity once a time")
    return table.select(table["type"] > 0)


def read_segments(truth: Path, tracks: Path) -> Iterator[Segment]:
    """Yield every segment of the two files; one that only one of them has is evaluated too."""
    sides = read_objects(truth, truth=True), read_objects(tracks, truth=False)
    strange = ~np.isin(sides[1]["context_name"], np.unique(sides[0]["context_name"]))
    sides[1].refuse("context_name", strange, f"a segment of {truth.name}")
    for name in np.unique(sides[0]["context_name"]).tolist():
        own = [side.select(side["context_name"] == name) for side in sides]
        stamps = np.unique(np.concatenate([side["frame_timestamp_micros"] for side in own]))
        boxes = [_boxes(side, stamps.tolist()) for side in own]
        yield Segment(name, len(stamps), *boxes)


def _boxes(table: Columns, stamps: Sequence[int]) -> SegmentBoxes:
    frame = np.searchsorted(stamps, table["frame_timestamp_micros"])
    order = np.argsort(frame, kind="stable")
    table = table.select(order)
    identity = np.unique(table["id"], return_inverse=True)[1].astype(np.int64)
    columns = (table[name] for name in ("type", "box", "score", "level", "ignored"))
    return SegmentBoxes(frame[order], identity, *columns)

"""The annotated boxes of the chosen scenes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mottrack.datasets.faults import MissingError, OutOfOrderError
from mottrack.datasets.files import MAX_BOX_SIZE_M, repeated_rows
from mottrack.datasets.nuscenes.columns import Kind
from mottrack.datasets.nuscenes.tables import (
    ROTATION,
    TOKEN,
    TRANSLATION,
    Columns,
    Expected,
    Rows,
    Tables,
    looked_up,
    text_of,
)

_TABLE = "sample_annotation"
_SIZE = Expected("size", f"three numbers in (0, {MAX_BOX_SIZE_M:g}] m")
_ONCE = Expected("instance_token", "each instance once a sample", OutOfOrderError)
_KINDS = (
    TOKEN,
    Kind("sample_token", text=True),
    Kind("instance_token", text=True),
    TRANSLATION,
    Kind("size", 3),
    ROTATION,
    Kind("num_lidar_pts", integer=True),
    Kind("num_radar_pts", integer=True),
)


def box_columns(tables: Tables, sample_index: dict[str, int]) -> Columns | None:
    """Return sample, instance (numbered), category, translation, size (w, l, h), rotation, points.

    Sorted by sample, else in the order of the table. None if the version has no annotations at
    all, as the test split.

    Raises:
        DataError: a damaged table, a value out of range, an instance twice in a sample, or one
            whose category is not there.
    """
    columns = tables.columns(_TABLE, _KINDS, Rows({"sample_token": sample_index}))
    if not len(columns["size"]) and next(tables.rows(_TABLE), None) is None:
        return None
    _check(tables, columns)
    columns["sample"] = looked_up(columns.pop("sample_token"), sample_index)
    instance = text_of(columns["instance_token"])
    number = {token: i for i, token in enumerate(dict.fromkeys(instance))}
    columns["instance"] = np.array([number[token] for token in instance], dtype=np.int64)
    columns["category"] = _categories(tables, number)[columns["instance"]]
    repeated = repeated_rows(np.column_stack([columns["sample"], columns["instance"]]))
    tables.refuse(_TABLE, columns, repeated, _ONCE)
    del columns["instance_token"]
    order = np.argsort(columns["sample"], kind="stable")
    return {name: values[order] for name, values in columns.items()}


def _categories(tables: Tables, number: dict[str, int]) -> NDArray[np.bytes_]:
    """Category name of each instance."""
    names = tables.columns("category", (TOKEN, Kind("name", text=True)))
    name_of = dict(zip(text_of(names["token"]), names["name"], strict=True))
    kinds = (TOKEN, Kind("category_token", text=True))
    found = tables.columns("instance", kinds, Rows({"token": number}))
    category_of = dict(zip(text_of(found["token"]), text_of(found["category_token"]), strict=True))
    for token in number:
        if token not in category_of:
            raise MissingError(tables.path("instance"), "record", "missing", f"instance {token}")
        if category_of[token] not in name_of:
            value = category_of[token]
            raise MissingError(tables.path("category"), "record", "missing", f"category {value}")
    return np.array([name_of[category_of[token]] for token in number], dtype=np.bytes_)


def _check(tables: Tables, columns: Columns) -> None:
    tables.check_poses(_TABLE, columns)
    size = columns["size"]
    outside = ((size <= 0.0) | (size > MAX_BOX_SIZE_M)).any(axis=1)
    tables.refuse(_TABLE, columns, np.asarray(outside), _SIZE)
    for name in ("num_lidar_pts", "num_radar_pts"):
        tables.refuse(_TABLE, columns, np.asarray(columns[name] < 0), Expected(name, "0 or more"))

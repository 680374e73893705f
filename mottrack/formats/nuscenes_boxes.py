"""Annotated boxes of nuScenes tables."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import I64
from mottrack.formats.checks import check_points_in_box, check_sizes, check_upright
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import MissingError
from mottrack.formats.nuscenes_links import LINKS, check_links, checked_poses
from mottrack.formats.nuscenes_tables import (
    ROTATION,
    TOKEN,
    TRANSLATION,
    NuScenesTables,
    looked_up,
    text_of,
)
from mottrack.formats.table_stream import RecordCount, RecordFilter

# fields of sample_annotation that the evaluation reads
_ANNOTATION = (
    TOKEN,
    *LINKS,
    ColumnSpec("sample_token", str),
    ColumnSpec("instance_token", str),
    TRANSLATION,
    ColumnSpec("size", width=3),
    ROTATION,
    ColumnSpec("num_lidar_pts", int),
    ColumnSpec("num_radar_pts", int),
)
_INSTANCE = (TOKEN, ColumnSpec("category_token", str), ColumnSpec("nbr_annotations", int))


class Annotations(NamedTuple):
    """The boxes of the chosen samples, and whether the tables have any of any sample.

    The tables of a test split hold no annotations at all.
    """

    table: Columns
    annotated: bool


def read_boxes(
    tables: NuScenesTables, sample_index: dict[str, int], every_sample: Collection[str]
) -> Annotations:
    """Return the annotations of samples, sorted by sample, else in the order of the table.

    They gain `sample` (its index), `instance` (numbered) and `category` (its name).

    Args:
        tables: the tables of a version.
        sample_index: the samples that are wanted.
        every_sample: the tokens of all samples that there are.

    Raises:
        DataError: a value is out of range, an annotation points to a record that is not there, or
            there are fewer than the instances say.
    """
    count = RecordCount()
    among = RecordFilter({"sample_token": sample_index}, {"sample_token": every_sample}, count)
    boxes = tables.columns("sample_annotation", _ANNOTATION, among)
    checked_poses(boxes)
    check_upright(boxes)
    check_sizes(boxes, "size")
    check_points_in_box(boxes, "num_lidar_pts", "num_radar_pts")
    instances_in_order = dict.fromkeys(boxes["instance_token"].tolist())
    number = {token.decode(): i for i, token in enumerate(instances_in_order)}
    sample = looked_up(boxes["sample_token"], sample_index)
    instance = looked_up(boxes["instance_token"], number)
    keys = np.column_stack([sample, instance])
    boxes.refuse_repeated("instance_token", keys, "each instance once a sample")
    instances = _instances(tables, count.records)
    rows = _rows_of(instances, number)
    _check_complete(instances.select(rows), np.bincount(instance, minlength=len(number)))
    order = np.lexsort((sample, instance))
    check_links(boxes.select(order), instance[order])
    category = _categories(tables, instances)[rows][instance]
    boxes = boxes.extended(sample=sample, instance=instance, category=category)
    return Annotations(boxes.select(np.argsort(sample, kind="stable")), count.records > 0)


def _instances(tables: NuScenesTables, annotations: int) -> Columns:
    """Return all instances, which must speak of as many annotations as there are."""
    instances = tables.columns("instance", _INSTANCE)
    expected = int(instances["nbr_annotations"].sum())
    if annotations != expected:
        path = tables.path("sample_annotation")
        words = f"{expected}, the sum of nbr_annotations in instance.json"
        raise MissingError(path, "number of records", annotations, words)
    return instances


def _rows_of(instances: Columns, number: dict[str, int]) -> I64:
    """Return the row of each numbered instance."""
    row_of = {token: row for row, token in enumerate(text_of(instances["token"]))}
    for token in number:
        if token not in row_of:
            raise MissingError(instances.path, "record", "missing", f"instance {token}")
    return np.array([row_of[token] for token in number], dtype=np.int64)


def _check_complete(instances: Columns, found: I64) -> None:
    """Refuse an instance with another number of annotations than its record says."""
    wrong = instances["nbr_annotations"] != found
    if wrong.any():
        row = int(np.argmax(wrong))
        expected = f"{found[row]}, the annotations that there are"
        instances.refuse("nbr_annotations", wrong, expected, MissingError)


def _categories(tables: NuScenesTables, instances: Columns) -> NDArray[np.bytes_]:
    """Return the category's name of each instance."""
    names = tables.columns("category", (TOKEN, ColumnSpec("name", str)))
    name_of = dict(zip(names["token"].tolist(), names["name"].tolist(), strict=True))
    known = np.isin(instances["category_token"], names["token"])
    instances.refuse("category_token", ~known, "the token of a category", MissingError)
    found = [name_of[token] for token in instances["category_token"].tolist()]
    return np.array(found, dtype=np.bytes_)


def box_arrays(boxes: Columns) -> dict[str, NDArray[Any]]:
    """Return what a scene's record keeps of its boxes."""
    return {
        "box_sample": boxes["sample"],
        "box_instance": np.unique(boxes["instance"], return_inverse=True)[1],
        "box_category": boxes["category"],
        "box_centre_m": boxes["translation"],
        "box_size_wlh_m": boxes["size"],
        "box_rotation": boxes["rotation"],
        "box_points": boxes["num_lidar_pts"] + boxes["num_radar_pts"],
    }

"""The names that a configuration can give to its parts; importing them loads no library."""

from __future__ import annotations

from collections.abc import Mapping

from mottrack.core.interfaces import TableEntry
from mottrack.datasets import DATASETS
from mottrack.flow import FLOWS
from mottrack.objects import OBJECTS
from mottrack.trackers import TRACKERS

TABLES: Mapping[str, Mapping[str, TableEntry]] = {
    "datasets": DATASETS,
    "objects": OBJECTS,
    "flows": FLOWS,
    "trackers": TRACKERS,
}
"""Plural of a part, as `mottrack list` takes it, to its names."""

"""The official TruckScenes splits.

Scenes are named by their drive and a number. The list, `truckscenes_splits.json`, gives the numbers
of each drive by split: that of truckscenes-devkit 1.2.0, so that no devkit is needed.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from functools import cache
from pathlib import Path

from mottrack.formats.nuscenes_splits import resolve_names

_LIST = Path(__file__).with_name("truckscenes_splits.json")


@cache
def truckscenes_splits() -> dict[str, tuple[str, ...]]:
    """Return the scene names of each official split, sorted."""
    drives = json.loads(_LIST.read_text())
    return {
        split: tuple(
            f"scene-{drive}-{number}"
            for drive, numbers in content.items()
            for number in numbers.split()
        )
        for split, content in drives.items()
    }


def resolve_truckscenes_split(split: str) -> tuple[str, ...]:
    """Return the scene names of an official split, or those listed in a text file, one a line.

    Raises:
        ConfigError: neither a split nor a file has that name.
        DataError: the file holds no names.
    """
    names: dict[str, Collection[str]] = {**truckscenes_splits()}
    return resolve_names(split, names)

"""Which scenes a data set has, which were asked for, and which of their frames exist."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from mottrack.core.errors import ConfigError, InputError, unknown_name
from mottrack.formats.faults import MissingError

SWEEP_OR_OPTION = "a file; dataset.require_sweeps=true leaves out frames without a sweep"
"""What is expected of a sweep by data sets that have the option."""


def scenes_in(folder: Path, pattern: str) -> tuple[str, ...]:
    """Return the sorted names of the scenes in a folder.

    Args:
        folder: where to look.
        pattern: `*.suffix` for one file a scene, `*/file` for one folder a scene.

    Raises:
        DataError: there is none.
    """
    paths = folder.glob(pattern)
    names = sorted(p.stem if p.parent == folder else p.parent.name for p in paths)
    if not names:
        raise MissingError(folder, "scenes", "none", pattern.replace("*", "<scene>"))
    return tuple(names)


def chosen_scenes(wanted: tuple[str, ...] | None, present: tuple[str, ...]) -> tuple[str, ...]:
    """Return the wanted scenes, or all that are there.

    Raises:
        ConfigError: a wanted scene is not there or comes twice, or none is wanted.
    """
    if wanted is None:
        return present
    if not wanted or len(set(wanted)) != len(wanted):
        raise ConfigError(f"dataset.scenes is {list(wanted)}, expected names, each once")
    for name in wanted:
        require_scene(name, present)
    return wanted


def require_scene(name: str, present: Collection[str]) -> None:
    """Raise `ConfigError` that lists the scenes if `name` is none of them."""
    if name not in present:
        raise unknown_name("scene", name, present)


def checked_index(index: int, count: int, scene: str) -> int:
    """Return the index of one of a scene's `count` frames; raise `InputError` for another."""
    if not 0 <= index < count:
        raise InputError("index", index, f"a frame of {scene} in 0 .. {count - 1}")
    return index

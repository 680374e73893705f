"""Which scenes of a data set were asked for."""

from __future__ import annotations

from collections.abc import Collection

from mottrack.core.errors import ConfigError, unknown_name


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

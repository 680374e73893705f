"""Values that several metrics of the same scenes need, computed once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

R = TypeVar("R")


class Memo:
    """Remembers the values of pure functions of scene results.

    Scores, differences between runs and the report all match the same tracks with the same truth;
    whoever hands the same memo to all of them pays for that once.
    """

    def __init__(self) -> None:
        self._values: dict[Hashable, tuple[object, Any]] = {}

    def __call__(self, function: Callable[..., R], *arguments: object, **options: object) -> R:
        """Return the function's value, from memory where the arguments were the same.

        Scene results, like anything with arrays, are the same if they are one object, lists of them
        if their members are. Other arguments are compared by value.
        """
        key = (function, *map(_key, arguments), *sorted(options.items()))
        if key not in self._values:
            # the arguments are kept as well: the id of a deleted object may be given to a new one
            self._values[key] = (arguments, function(*arguments, **options))
        value: R = self._values[key][1]
        return value


def _key(argument: object) -> Hashable:
    if isinstance(argument, list):
        return tuple(map(_key, argument))
    try:
        hash(argument)
    except TypeError:
        return id(argument)
    return argument

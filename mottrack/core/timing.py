"""Lets whoever times a stage learn what a part deep inside it took (the ground, within the flow).

The part names itself; nobody listening, it costs a look-up. What listens is set by the caller
and belongs to its thread of execution, so two pipelines never hear each other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Listener = Callable[[str, float], None]
"""Is told the name of a part and the seconds that it took."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def timed(name: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Marks a function as a part that is timed by name inside the stage that calls it."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def timed(*args: P.args, **kwargs: P.kwargs) -> R:
            listener = _listener.get()
            if listener is None:
                return function(*args, **kwargs)
            start = time.perf_counter()
            result = function(*args, **kwargs)
            listener(name, time.perf_counter() - start)
            return result

        return timed

    return decorate


@contextmanager
def collect_timings(listener: Listener) -> Iterator[None]:
    """Within the block, ``listener`` is told what each part took."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)

"""Timings of parts within a stage, such as the ground estimate within the flow.

A part is a function with the decorator `timed`; a caller collects its timings within
`collect_timings`. Without a collector a part costs one look-up. The collector belongs to the
caller's context (thread or task), so two pipelines never collect each other's timings.
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
"""Receives the name of a part and the seconds that it took."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def timed(name: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Mark a function as a part that is timed by name inside the stage that calls it."""

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
    """Pass the timing of each part that runs within the block to ``listener``."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)

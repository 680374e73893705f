"""Timings of parts within a stage, such as the ground estimate within the flow.

A part is a function with the decorator `timed`; a caller collects its timings within
`collect_timings`. Without a collector a part costs one look-up. The collector belongs to the
caller's context (thread or task), so two pipelines never collect each other's timings.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Listener = Callable[[str, float], None]
"""Receives the name of a part and the seconds that it took."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_charged_s: ContextVar[float] = ContextVar("charged_s", default=0.0)


def clock_s() -> float:
    """Return the time by which stages are measured: wall time, and what was charged to it."""
    return time.perf_counter() + _charged_s.get()


def charge(seconds: float, parts: Mapping[str, float]) -> None:
    """Count work that was done before, for another run, as if it had been done now.

    Args:
        seconds: what the work took, its parts included.
        parts: seconds of the parts that were timed within it.
    """
    _charged_s.set(_charged_s.get() + seconds)
    listener = _listener.get()
    if listener is not None:
        for name, part_s in parts.items():
            listener(name, part_s)


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

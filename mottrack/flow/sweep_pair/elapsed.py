"""The time between the two sweeps of a pair."""

from __future__ import annotations

from mottrack.core.errors import InputError
from mottrack.core.sweep import Sweep, seconds_between


def elapsed_seconds(previous: Sweep, current: Sweep) -> float:
    """Seconds from ``previous`` to ``current``.

    Raises:
        InputError: ``current`` is not later than ``previous``.
    """
    if current.stamp_ns <= previous.stamp_ns:
        raise InputError("stamp_ns of current", current.stamp_ns, f"> {previous.stamp_ns}")
    return seconds_between(previous.stamp_ns, current.stamp_ns)

"""Whether this process may run the network: threads of torch and numba do not survive a fork."""

from __future__ import annotations

import os

from mottrack.core.errors import ConfigError


class _Threads:
    """Of the libraries that the network uses; they belong to one process."""

    used = False
    lost = False
    """Whether they were used before a fork: in the child, their locks wait for nobody."""


def require_threads() -> None:
    """Note that the network is about to run.

    Raises:
        ConfigError: this process was forked from one that had run it, and would wait for ever.
    """
    if _Threads.lost:
        raise ConfigError(
            "pillarflow has run before this process was forked, and its threads are gone: start "
            "processes by multiprocessing's spawn, or fork before the first step"
        )
    _Threads.used = True


def _after_fork() -> None:
    _Threads.lost = _Threads.used


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_after_fork)

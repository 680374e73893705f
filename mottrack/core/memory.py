"""Memory that this process may still take, and a word before the kernel ends it."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

if sys.platform != "win32":
    import resource

GIB = 1 << 30
SCARCE_BYTES = 150 << 20
"""Left of the memory where a word is said: a sweep with its features and its flow takes less."""
PERIOD_S = 0.5
"""Between two looks; a process fills a gigabyte in about that time."""
_GROUP = Path("/sys/fs/cgroup")
"""Where Linux shows the limits of a container to a process in it."""


def left_bytes() -> int | None:
    """Return how much memory this process may still take; None where the system does not say.

    The least of what the machine has, what the container is allowed (cgroup, version 1 or 2) and
    what the process is (`ulimit -v`).
    """
    known = [*_machine(), *_container(), *_process()]
    return max(min(known), 0) if known else None


def fitting(processes: int, each_bytes: int) -> int:
    """Return how many of these processes fit into the memory that is left, at least one."""
    left = left_bytes()
    return processes if left is None else max(min(processes, left // each_bytes), 1)


def warn_when_scarce() -> None:
    """Print one line on standard error when memory is nearly exhausted.

    The kernel ends a process without a word. To be called once, in each process that works.
    """

    def watch() -> None:
        while (left := left_bytes()) is not None:
            if left < SCARCE_BYTES:
                sys.stderr.write(f"mottrack: {exhausted(left)}\n")
                return
            threading.Event().wait(PERIOD_S)

    threading.Thread(target=watch, daemon=True, name="watch memory").start()


def exhausted(left: int | None = None) -> str:
    """Return the words for memory that is, or is nearly, exhausted."""
    found = "" if left is None else f" ({left >> 20} MiB left)"
    return f"memory is exhausted{found}: use fewer --workers, or a machine or container with more"


def _machine() -> Iterator[int]:
    for line in _lines(Path("/proc/meminfo")):
        if line.startswith("MemAvailable:"):
            yield int(line.split()[1]) << 10


def _container() -> Iterator[int]:
    for most, used, cached in (
        ("memory.max", "memory.current", "memory.stat"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat"),
    ):
        limit, now = (_number(_GROUP / name) for name in (most, used))
        if limit is not None and now is not None:
            # the kernel drops pages of files that nobody uses before it ends a process
            yield limit - now + _inactive(_GROUP / cached)


def _inactive(path: Path) -> int:
    rows = (line.split() for line in _lines(path))
    return sum(int(row[1]) for row in rows if row[0] == "inactive_file")


def _process() -> Iterator[int]:
    if sys.platform == "win32":
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    pages = next(iter(_lines(Path("/proc/self/statm"))), "")
    if limit != resource.RLIM_INFINITY and pages:
        yield limit - int(pages.split()[0]) * os.sysconf("SC_PAGE_SIZE")


def _number(path: Path) -> int | None:
    text = next(iter(_lines(path)), "")
    return int(text) if text.isdigit() else None  # "max" is no limit


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, ValueError):
        return []

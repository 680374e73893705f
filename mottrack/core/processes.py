"""Worker processes: how many there can be, and their end when the parent dies."""

from __future__ import annotations

import os
import sys
import threading
from multiprocessing import parent_process


def available_cores() -> int:
    """Return how many processes can work at once: cores that this process may use."""
    if sys.platform != "linux":  # elsewhere a process can't be bound to some of the cores
        return os.cpu_count() or 1
    return len(os.sched_getaffinity(0))


def end_with_parent() -> None:
    """End this worker process as soon as its parent has died, even by SIGKILL.

    Workers of a pool would otherwise wait for tasks for ever. To be called once, in the worker.
    """
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="end with parent").start()

"""Kernels run over slices of their work by a few threads.

Every kernel writes only what belongs to its slice and draws its noise by index, so the result does
not depend on the number of threads. Plain threads (numba releases the interpreter lock) are safe
beside process pools and other threads, where numba's own parallel regions are not.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

Span = tuple[int, int]
"""First and one past the last index of a slice."""

SLICES_PER_THREAD = 4
"""Obstacles are concentrated in a few rows: smaller slices balance the load."""


class Workers:
    """A fixed number of threads, which a forked process starts for itself."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def run(self, kernel: Callable[..., Any], length: int, *arguments: object) -> None:
        """Call `kernel(span, *arguments)` for spans that together cover [0, length)."""
        if self._threads == 1:
            kernel((0, length), *arguments)
            return
        pool = self._running()
        slices = self._threads * SLICES_PER_THREAD
        bounds = [length * k // slices for k in range(slices + 1)]
        spans = pairwise(bounds)
        for done in [pool.submit(kernel, span, *arguments) for span in spans]:
            done.result()

    def _running(self) -> ThreadPoolExecutor:
        """Return the threads of this process: a fork copies the pool, but none of its threads."""
        if self._pool is None or self._process != os.getpid():
            self._pool, self._process = ThreadPoolExecutor(self._threads), os.getpid()
        return self._pool

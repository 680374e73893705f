"""How many CPU threads torch and numba may use."""

from __future__ import annotations

import numba
import torch


def use_threads(count: int) -> None:
    """Let torch and numba use `count` threads each from here on; 0 keeps torch's own count.

    The order matters: where both share one OpenMP, starting numba's threads sets the count of
    torch to the number of cores, so torch is told last. Sums over more threads round differently.
    """
    count = count or torch.get_num_threads()
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    torch.set_num_threads(count)

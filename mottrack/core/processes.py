"""What a helper process owes to the one that started it."""

from __future__ import annotations

import os
import threading
from multiprocessing import parent_process


def end_with_parent() -> None:
    """Ends this process as soon as its parent is gone, killed without a chance to tell.

    Workers of a pool would else wait for work for ever. To be called once, in the helper.
    """
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="end with parent").start()

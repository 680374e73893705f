"""A lock on a run's folder: one driver at a time, released when its process ends."""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mottrack.core.errors import ConfigError

NAME = ".driver"


@contextmanager
def only_driver(folder: Path) -> Iterator[None]:
    """Hold a folder for this process.

    The kernel holds the lock, so that one of a killed process is no obstacle. It also holds
    between machines where their file system passes locks on, as NFS 4, Lustre and CephFS do.

    Raises:
        ConfigError: another process works in the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    with path.open("a+", encoding="utf-8", errors="replace") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            raise ConfigError(
                f"{folder} is in use by {file.read().strip() or 'another process'}; wait for it, "
                "or choose another --out"
            ) from error
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}\n")
        file.flush()
        yield

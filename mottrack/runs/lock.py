"""A lock on a folder of results: one driver at a time, released when its process ends."""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mottrack.core.errors import ConfigError
from mottrack.runs.shard import Shard

NAME = ".driver"


@contextmanager
def only_driver(folder: Path, part: Shard = Shard()) -> Iterator[None]:  # noqa: B008 - immutable
    """Hold a folder for this process, or one part of the work in it beside drivers of other parts.

    The kernel holds the lock, so that one of a killed process is no obstacle. It also holds
    between machines where their file system passes locks on, as NFS 4, Lustre and CephFS do.

    Raises:
        ConfigError: another process works in the folder, or on the same part.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _held(folder / NAME, exclusive=part.whole):
        if part.whole:
            yield
        else:
            with _held(folder / f"{NAME}-{part.index}-of-{part.count}", exclusive=True):
                yield


@contextmanager
def _held(path: Path, *, exclusive: bool) -> Iterator[None]:
    with path.open("a+", encoding="utf-8", errors="replace") as file:
        kind = fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH
        try:
            fcntl.flock(file, kind | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            raise ConfigError(
                f"{path.parent} is in use by {file.read().strip() or 'another process'}; wait for "
                "it, or choose another --out"
            ) from error
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}\n")
        file.flush()
        yield

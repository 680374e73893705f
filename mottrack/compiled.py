"""Numba compilation that keeps a function's signature, so that type checkers see its callers."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, overload

import numba

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS = {"no_cfunc_wrapper": True}
"""A wrapper by which C would call a function costs a second compilation, and nobody calls so."""
COMPILING_S = 75.0
"""CPU time of the first `mottrack demo` that goes into compilation, told to who waits for it: as
`mottrack warm` measured it on a 2-core machine."""


@overload
def compiled(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def compiled(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def compiled(function: Callable[P, R] | None = None, /, **options: Any) -> Any:
    """Compile a function in numba's nopython mode, cached on disk.

    The cache is `NUMBA_CACHE_DIR`, else the function's own folder, else the user's cache folder,
    else `temporary_cache`; where nothing can be written, each process compiles again.

    Copy arrays element by element: `target[a:b] = source` compiles numba's text of the error for
    unequal shapes, one to two seconds in every function that does so.

    numba ships no types: its own decorator turns a function into `Any`, and a call with wrong
    arguments is found only when it is compiled. The function must not use `self`, and its callees
    must be compiled too.

    Args:
        function: the function to compile, when the decorator is used without parentheses.
        options: options of `numba.njit`, such as ``parallel`` or ``fastmath``.
    """
    options = {**OPTIONS, **options}

    def decorate(function: Callable[P, R]) -> Any:
        try:
            return numba.njit(cache=True, **options)(function)
        except RuntimeError:  # numba found no writable folder ("no locator available")
            folder = temporary_cache()
        numba.config.CACHE_DIR = "" if folder is None else str(folder)
        return numba.njit(cache=folder is not None, **options)(function)

    return decorate if function is None else decorate(function)


def cache_place(function: Any) -> Path | None:
    """Return the folder in which a compiled function is kept between processes; None: nowhere."""
    path = function.stats.cache_path
    return None if path is None else Path(path)


@contextmanager
def compilation_told(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` whenever this process begins to compile, in the block, what no cache holds."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, _: Any) -> None:
            tell()

        def on_end(self, _: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


def temporary_cache() -> Path | None:
    """Return this user's folder for compiled functions among the temporary files, or None.

    numba's cache consists of pickles, which run code when they are read: a folder that another
    user owns or can write to is never used.
    """
    try:
        folder = Path(tempfile.gettempdir()) / f"mottrack-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except (OSError, AttributeError):  # nothing is writable; no getuid on Windows
        return None
    mine = found.st_uid == os.getuid() and stat.S_ISDIR(found.st_mode)
    private = not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return folder if mine and private and os.access(folder, os.W_OK) else None

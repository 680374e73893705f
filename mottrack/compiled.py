"""Numba compilation that keeps a function's signature, so that type checkers see its callers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, overload

import numba

P = ParamSpec("P")
R = TypeVar("R")


@overload
def compiled(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def compiled(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def compiled(function: Callable[P, R] | None = None, /, **options: Any) -> Any:
    """Compile a function in numba's nopython mode, cached on disk beside its file.

    numba ships no types: its own decorator turns a function into `Any`, and a call with wrong
    arguments is found only when it is compiled. The function must not use `self`, and its callees
    must be compiled too.

    Args:
        function: the function to compile, when the decorator is used without parentheses.
        options: options of `numba.njit`, such as ``parallel`` or ``fastmath``.
    """
    decorate = numba.njit(cache=True, **options)
    return decorate if function is None else decorate(function)

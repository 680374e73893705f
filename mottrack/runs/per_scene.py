"""Something of every scene of a run that is read when it is asked for, and not held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar, overload

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class PerScene(Sequence[T]):
    """What a function reads of each scene: a sequence that may be larger than the memory.

    It can be gone through several times; each time everything is read again.
    """

    scenes: tuple[str, ...]
    read: Callable[[str], T]

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> PerScene[T]: ...
    def __getitem__(self, index: int | slice) -> T | PerScene[T]:
        if isinstance(index, slice):
            return PerScene(self.scenes[index], self.read)
        return self.read(self.scenes[index])

    def __len__(self) -> int:
        return len(self.scenes)

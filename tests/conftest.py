"""Fixtures that every test may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with small recorded data sets, where there is one."""
    default = REPOSITORY.parent / "shared" / "data"
    folder = Path(os.environ.get("MOTTRACK_SHARED_DATA", default))
    if not folder.is_dir():
        pytest.skip("no recorded data here: set MOTTRACK_SHARED_DATA to their folder")
    return folder


class SilentProgress:
    """Progress that nobody watches."""

    def begin(self, title: str, tasks: int, todo: int) -> None:
        self.todo = todo

    def advances(self, progress: object) -> None: ...

    def compiling(self) -> None: ...

    def ends(self, outcome: object) -> None: ...


@pytest.fixture(scope="session")
def progress() -> SilentProgress:
    return SilentProgress()


@pytest.fixture(scope="session", autouse=True)
def _importable_plugins() -> Iterator[None]:
    """Lets a configuration name the classes of `tests/plugins` as ``module:Class``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(REPOSITORY / "tests" / "plugins"))
        yield

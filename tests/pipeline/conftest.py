from pathlib import Path

import pytest


class SilentProgress:
    def begin(self, title: str, scenes: int, todo: int) -> None:
        self.todo = todo

    def frames(self, scene: str, done: int, total: int) -> None: ...

    def scene_ends(self, outcome: object) -> None: ...


@pytest.fixture
def progress() -> SilentProgress:
    return SilentProgress()


@pytest.fixture(autouse=True)
def _toys_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))

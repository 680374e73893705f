"""Fixtures that every test may use."""

from __future__ import annotations

import os
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

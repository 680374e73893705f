"""Settings of MOTChallenge sequences."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mottrack.config import StrictModel


class MotConfig(StrictModel):
    """MOTChallenge sequences on disk."""

    root: Path = Field(description="folder that holds `<sequence>/gt/gt.txt`, or `gt.txt` in each")
    scenes: tuple[str, ...] | None = Field(None, description="sequences; none given: all")
    rate_hz: float = Field(
        25.0, gt=0, le=1000, description="frames a second where `seqinfo.ini` does not say it"
    )
    label: str = Field(
        "person",
        min_length=1,
        description="class of all boxes; one of nuScenes' would be scored within its range only",
    )

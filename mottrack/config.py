"""The base of every configuration model."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict


class StrictModel(BaseModel):
    """A configuration: frozen, an unknown key is an error, and NaN is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def files(self) -> tuple[Path, ...]:
        """Files that decide results beside the settings and the data: a network's weights."""
        return ()

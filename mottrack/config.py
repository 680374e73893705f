"""Base class of every configuration model."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict


class StrictModel(BaseModel):
    """A configuration: frozen; unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def files(self) -> tuple[Path, ...]:
        """Return the files beside the settings and the data that decide results: weights."""
        return ()

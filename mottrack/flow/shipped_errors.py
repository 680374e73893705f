"""Error models of the shipped sources, as `mottrack calibrate-errors` measured them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel, read_error_models

FILE = Path(__file__).parent / "velocity_errors.json"
"""Written by `mottrack calibrate-errors velocity_errors`; that configuration says on what."""


def shipped_errors(name: str) -> VelocityErrorModel:
    """Return the model of a shipped source; one without errors beside its covariance if unknown.

    Weights of a user's own are believed as they state themselves until they are calibrated.
    """
    return _models().get(name, NO_OUTLIERS)


@cache
def _models() -> dict[str, VelocityErrorModel]:
    return read_error_models(FILE)

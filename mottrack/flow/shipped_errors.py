"""Error models of the shipped sources, as `mottrack calibrate-errors` measured them.

Weights of a user's own may have theirs in a file beside them.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel, read_error_models

FILE = Path(__file__).parent / "velocity_errors.json"
"""Written by `mottrack calibrate-errors velocity_errors`; that configuration says on what."""
RAW = "_raw"
"""Ends the name of a network whose field no stage refines."""


def shipped_errors(name: str) -> VelocityErrorModel:
    """Return the model of a shipped source; one without errors beside its covariance if unknown.

    Weights of a user's own are believed as they state themselves until they are calibrated.
    """
    return _models().get(name, NO_OUTLIERS)


def weights_errors(weights: str, *, refined: bool) -> VelocityErrorModel:
    """Return the error model of a network: shipped, or from the file beside a user's weights.

    Raises:
        DataError: that file is damaged.
    """
    name = "refined" if refined else "raw"
    file = errors_file(Path(weights))
    if weights.endswith(".safetensors") and file.is_file():
        return read_error_models(file).get(name, NO_OUTLIERS)
    return shipped_errors(weights if refined else weights + RAW)


def errors_file(weights: Path) -> Path:
    """Return where the error models of a file of weights lie."""
    return weights.with_suffix(".errors.json")


def write_beside(weights: Path, like: str) -> None:
    """Give a file of weights the error models of those that they were tuned from.

    Without labels no other can be measured; `mottrack calibrate-errors` does it on scenes with
    truth.
    """
    models = {name: weights_errors(like, refined=name == "refined") for name in ("refined", "raw")}
    plain = {
        name: asdict(model) | {"class_variances": dict(model.class_variances)}
        for name, model in models.items()
    }
    write_text(errors_file(weights), json.dumps(plain, indent=1) + "\n")


@cache
def _models() -> dict[str, VelocityErrorModel]:
    return read_error_models(FILE)

"""JSON that every reader takes: it has no NaN and no infinity."""

import math
from typing import Any


def strict(value: Any) -> Any:
    """The same structure of dicts and lists with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: strict(item) for key, item in value.items()}
    if isinstance(value, list):
        return [strict(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

"""JSON without NaN and infinity, which the standard does not have."""

import math
from typing import Any


def strict(value: Any) -> Any:
    """Return the same dicts and lists with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: strict(item) for key, item in value.items()}
    if isinstance(value, list):
        return [strict(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

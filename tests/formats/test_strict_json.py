"""What has no number becomes null, at any depth."""

import json

import numpy as np

from mottrack.formats.strict_json import strict


def test_no_nan_and_no_infinity_is_left() -> None:
    given = {"a": [1.5, float("nan"), {"b": -np.inf}], "c": np.float64("nan"), "d": "nan", "e": 2}
    text = json.dumps(strict(given), allow_nan=False)
    assert json.loads(text) == {"a": [1.5, None, {"b": None}], "c": None, "d": "nan", "e": 2}

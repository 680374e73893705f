"""Settings that the presets of the Kalman tracker give, under those of the user."""

from __future__ import annotations

from typing import Any

from mottrack.config import StrictModel


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the nested mapping `base` with `changes` on top of it."""
    result = dict(base)
    for key, value in changes.items():
        if isinstance(value, StrictModel):
            value = value.model_dump(exclude_unset=True)
        old = result.get(key)
        both = isinstance(old, dict) and isinstance(value, dict)
        result[key] = merged(old, value) if both else value  # type: ignore[arg-type]
    return result


# settings of the released StanfordIPRL-TRI tracker (Chiu et al., 2020)
_PUBLISHED: dict[str, Any] = {
    "time": "frames",
    "yaw": "published",
    "drop_unknown": True,
    "noise": {"table": "chiu2020-megvii", "form": "diagonal"},
    "velocity": {"use": False, "test": {"use": False}},
    "standing": {"use": False},
    "association": {"gate": 11.0, "float32": True},
    "nms": {"enabled": False},
    "track_management": {
        "min_hits": 3,
        "max_misses": 1,
        "output_misses": 1,
        "undetected_classes": "freeze",
        "score": "last",
    },
}

PRESETS: dict[str, dict[str, Any]] = {
    "default": {
        "association": {
            "components": "xy",
            "gate": 5.0,
            # 20 new road users of a class on 100 m x 100 m: a prior that five frames replace
            "clutter_density_per_m2": 0.002,
            "estimate_clutter": True,
            "estimate_score_weight": True,
        },
        "nms": {"enabled": True},
        "track_management": {"rule": "existence", "max_misses": 5, "max_coast_s": 6.0},
    },
    "stanford_iprl_tri": _PUBLISHED,
    # the 9-D observation with blockdiag(R, R_d) of section IV-D and nothing else: every velocity
    # that was measured is believed as far as R_d says
    "pillarflow": _PUBLISHED
    | {
        "velocity": {
            "use": True,
            "test": {"use": False},
            "birth": "replace",
            "noise": "class",
            "relative": 0.0,
            "p_missed_motion": 0.0,
            "p_missed_slow": 0.0,
            "p_outlier": 0.0,
            "persistence": 0.0,
        }
    },
}

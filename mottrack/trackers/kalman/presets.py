"""Named starting points of the Kalman tracker's settings."""

from typing import Any

_PUBLISHED: dict[str, Any] = {
    "time": "frames",
    "yaw": "published",
    "drop_unknown": True,
    "noise": {"table": "chiu2020-megvii", "form": "diagonal"},
    "velocity": {"use": False},
    "association": {"gate": 11.0, "float32": True},
    "nms": {"enabled": False},
    "life": {
        "min_hits": 3,
        "max_misses": 1,
        "output_misses": 1,
        "silent_classes": "freeze",
        "score": "last",
    },
}

_FLOW_ERRORS = {"relative": 0.45, "lost_share": 0.35, "gross_share": 0.1, "gross_mps": 5.0}
"""How measured flow errs beside R_d (`velocity_belief`); zero suits a radar or the truth."""

PRESETS: dict[str, dict[str, Any]] = {
    "default": {
        "association": {
            "components": "planar",
            "gate": 5.0,
            "stray_per_m2": 0.01,
            "strays_per_m2": dict.fromkeys(("car", "truck", "bus", "trailer"), 0.004),
        },
        "velocity": _FLOW_ERRORS,
        "nms": {"enabled": True},
        "life": {
            "confirm_s": 0.25,
            "max_coast_s": 1.5,
            "output_coast_s": 0.6,
            "earn_coasting": True,
            "decay_per_s": 0.5,
        },
    },
    "stanford_iprl_tri": _PUBLISHED,
    "pillarflow": _PUBLISHED | {"velocity": {"use": True, "birth": "replace"} | _FLOW_ERRORS},
}

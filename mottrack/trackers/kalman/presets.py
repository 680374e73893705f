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

PRESETS: dict[str, dict[str, Any]] = {
    "default": {
        "association": {
            "components": "planar",
            "gate": 5.0,
            "stray_per_m2": 0.01,
            "strays_per_m2": dict.fromkeys(("car", "truck", "bus", "trailer"), 0.004),
        },
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
    "pillarflow": _PUBLISHED | {"velocity": {"use": True, "birth": "replace"}},
}

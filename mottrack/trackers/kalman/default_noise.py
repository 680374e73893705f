"""Noise of the default preset, in SI units, and what each number stands for.

One row a class: the standard deviations that a LiDAR detector's boxes have about the truth, and
how road users move. Speeds and accelerations are physical (what such objects do on roads), not
fitted to a scene.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Motion:
    """Standard deviations: of the box about the truth, and of the motion of a class."""

    centre_m: float
    height_m: float
    yaw_rad: float
    size_m: tuple[float, float, float]
    speed_mps: float
    acceleration_mps2: float
    yaw_rate_rps: float
    along_ratio: float = 1.0
    across_ratio: float = 0.3


CORRELATION_S = 1.0
"""Accelerations and turns hold for about a second: q = 2 sigma^2 tau is their spectral density."""

WANDER_M2PS = 0.01
"""Random walk of the observed centre on the body: detectors shift as the visible side changes."""

WANDER_RAD2PS = 0.01
"""The same of the observed heading."""

SIZE_M2PS = 0.0025
"""Random walk of the observed size, for the same reason."""

DEFAULT: dict[str, Motion] = {
    "car": Motion(0.25, 0.15, 0.20, (0.25, 0.12, 0.12), 12.0, 1.5, 0.3, across_ratio=0.15),
    "truck": Motion(0.40, 0.25, 0.20, (0.70, 0.20, 0.25), 12.0, 1.2, 0.2, across_ratio=0.15),
    "bus": Motion(0.45, 0.25, 0.15, (0.80, 0.20, 0.25), 12.0, 1.2, 0.2, across_ratio=0.15),
    "trailer": Motion(0.50, 0.30, 0.25, (1.00, 0.25, 0.30), 10.0, 1.2, 0.2, across_ratio=0.15),
    "motorcycle": Motion(0.22, 0.15, 0.30, (0.18, 0.10, 0.12), 5.0, 1.8, 0.5),
    "bicycle": Motion(0.22, 0.15, 0.30, (0.18, 0.10, 0.12), 3.0, 1.2, 0.5),
    "cyclist": Motion(0.22, 0.15, 0.30, (0.18, 0.10, 0.12), 3.0, 1.2, 0.5),
    "pedestrian": Motion(0.18, 0.15, 0.50, (0.15, 0.12, 0.14), 1.3, 0.6, 0.8, across_ratio=1.0),
}

UNKNOWN = Motion(0.30, 0.20, 0.30, (0.40, 0.20, 0.20), 5.0, 1.5, 0.4, across_ratio=1.0)
"""Any other class: something on the road of which nothing is known."""


def variances(motion: Motion) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """R (7), P0 (11) and Q per second (11) of a class, as `ClassNoise` holds them."""
    position, height = motion.centre_m**2, motion.height_m**2
    size = tuple(s**2 for s in motion.size_m)
    observation = (position, position, height, motion.yaw_rad**2, *size)
    rates = (motion.speed_mps**2, motion.speed_mps**2, 0.25, motion.yaw_rate_rps**2)
    push = 2.0 * motion.acceleration_mps2**2 * CORRELATION_S
    turn = 2.0 * motion.yaw_rate_rps**2 / CORRELATION_S
    wander = (WANDER_M2PS, WANDER_M2PS, WANDER_M2PS, WANDER_RAD2PS)
    process = (*wander, SIZE_M2PS, SIZE_M2PS, SIZE_M2PS, push, push, 0.05, turn)
    return observation, observation + rates, process

"""Prediction of the particles: those at rest stay, the others move at constant velocity.

Nuss et al. move every particle with white noise on its velocity. Along a wall no measurement
contradicts that noise and the wall seems to slide, so particles here also have a state of rest
(velocity exactly zero), which they leave and enter at a configured rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.flow.dogma.noise import draw, normal_level, uniform_level
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.workers import Span

REFERENCE_PERIOD_S = 0.1
"""Noise, survival and forgetting are given for one revolution of a 10 Hz LiDAR."""


class ParticleMotionConfig(StrictModel):
    """How particles move; noise and survival per 0.1 s, scaled to the elapsed time."""

    position_noise_m: float = Field(0.05, ge=0, description="standard deviation of position noise")
    velocity_noise_mps: float = Field(0.4, ge=0, description="standard deviation, velocity noise")
    start: float = Field(0.01, ge=0, le=1, description="probability that a resting particle starts")
    rest_below_mps: float = Field(0.3, ge=0, description="a slower particle comes to rest")
    survival: float = Field(0.99, gt=0, le=1, description="probability that a particle persists")


class MotionStep(NamedTuple):
    """`ParticleMotionConfig` over one prediction, as the kernel takes it."""

    dt_s: np.float32
    shift_x_m: np.float32
    """Added to x: minus the distance that the window moved."""
    shift_y_m: np.float32
    position_noise_m: np.float32
    velocity_noise_mps: np.float32
    start: np.float32
    rest_below_mps: np.float32

    @classmethod
    def over(
        cls, dt_s: float, shift_m: tuple[float, float], config: ParticleMotionConfig
    ) -> MotionStep:
        """Return the step over `dt_s`; noise grows with the square root of time."""
        growth = np.sqrt(dt_s / REFERENCE_PERIOD_S)
        return cls(
            np.float32(dt_s),
            np.float32(shift_m[0]),
            np.float32(shift_m[1]),
            np.float32(config.position_noise_m * growth),
            np.float32(config.velocity_noise_mps * growth),
            np.float32(1 - (1 - config.start) ** (dt_s / REFERENCE_PERIOD_S)),
            np.float32(config.rest_below_mps),
        )


def survival_over(dt_s: float, config: ParticleMotionConfig) -> float:
    """Return the probability p_S that a particle persists over `dt_s`."""
    return float(config.survival ** (dt_s / REFERENCE_PERIOD_S))


@compiled(nogil=True)
def predict(span: Span, particles: Particles, motion: MotionStep, key: np.uint64) -> None:
    """Predict in place: x += v dt + N(0, sigma_p), v += N(0, sigma_v); at rest both stay."""
    slow2 = motion.rest_below_mps * motion.rest_below_mps
    for i in range(span[0], span[1]):
        bits = draw(key, np.uint64(i))
        vx, vy = particles.vx_mps[i], particles.vy_mps[i]
        resting = (vx == 0) & (vy == 0)
        noise_m = np.float32(0) if resting else motion.position_noise_m
        along_x = vx * motion.dt_s + noise_m * normal_level(bits, 0)
        along_y = vy * motion.dt_s + noise_m * normal_level(bits, 1)
        particles.x_m[i] += along_x + motion.shift_x_m
        particles.y_m[i] += along_y + motion.shift_y_m
        vx += motion.velocity_noise_mps * normal_level(bits, 2)
        vy += motion.velocity_noise_mps * normal_level(bits, 3)
        stays = resting & (uniform_level(bits, 4) >= motion.start)
        stops = vx * vx + vy * vy < slow2
        particles.vx_mps[i] = np.float32(0) if stays | stops else vx
        particles.vy_mps[i] = np.float32(0) if stays | stops else vy

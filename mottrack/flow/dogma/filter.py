"""One cycle of the dynamic occupancy grid map: predict, update, birth, moments, resample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.errors import InputError
from mottrack.flow.dogma.births import BirthConfig, VelocityPrior, allocate_births, draw_births
from mottrack.flow.dogma.measurement_grid import Masses
from mottrack.flow.dogma.noise import stream, uniform
from mottrack.flow.dogma.occupancy import OccupancyConfig, Prior, Rates, Split, update_occupancy
from mottrack.flow.dogma.particles import Moments, Particles, assign, velocity_moments
from mottrack.flow.dogma.predict import (
    MotionStep,
    ParticleMotionConfig,
    predict,
    survival_over,
)
from mottrack.flow.dogma.resample import Candidates, resample
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers
from mottrack.lidar.scrolling import scrolled

_PREDICT, _ALLOCATE, _BIRTH, _RESAMPLE = range(4)
"""Stages that draw random numbers, each from a stream of its own."""


class FilterConfig(StrictModel):
    """The filter's parameters; the symbols of the paper are in the descriptions."""

    particles: int = Field(300_000, ge=1, description="persistent particles, nu")
    births: int = Field(30_000, ge=1, description="new-born particles per cycle, nu_b")
    motion: ParticleMotionConfig = ParticleMotionConfig()
    occupancy: OccupancyConfig = OccupancyConfig()
    birth: BirthConfig = BirthConfig()
    seed: int = Field(0, ge=0, description="seed of all random numbers")


@dataclass(frozen=True)
class GridMap:
    """The dynamic occupancy grid map after one cycle, in world axes."""

    window: Window
    masses: Masses
    """Posterior mass of occupied and free."""
    split: Split
    """Occupied mass by origin; the velocity is that of the persistent part."""
    moments: Moments
    """Velocity of the persistent mass."""


class DynamicGridFilter:
    """Particles and free mass on a window that may move by whole cells between cycles."""

    def __init__(self, config: FilterConfig, workers: Workers) -> None:
        self.config = config
        self._workers = workers
        self._particles = Particles.empty(config.particles)
        self._spare = Particles.empty(config.particles)
        self._mass_each = 0.0
        self._window: Window | None = None
        self._masses = Masses.unknown((0, 0))
        self._cycle = 0

    @property
    def particles(self) -> Particles:
        """The resampled particles; overwritten by the next cycle but one."""
        return self._particles

    @property
    def mass_each(self) -> float:
        """Occupied mass that each particle stands for."""
        return self._mass_each

    def step(self, measured: Masses, window: Window, dt_s: float) -> GridMap:
        """Advance by `dt_s` seconds to a measurement on `window`.

        Raises:
            InputError: `dt_s` is not positive, the measurement has another shape than the window,
                or the window has another size than before.
        """
        self._check(measured, window, dt_s)
        before = self._window or window
        self._follow(before, window, dt_s)
        assignment = assign(self._particles, window, before, self._workers)
        weight = survival_over(dt_s, self.config.motion) * self._mass_each
        rates = Rates.over(dt_s, self.config.occupancy)
        prior = Prior(assignment.start, weight, self._masses, rates)
        posterior, split = update_occupancy(prior, measured, self._workers)
        births = allocate_births(split.born, self.config.births, self._key(_ALLOCATE))
        free = self._masses.free
        velocity = VelocityPrior.of(self.config.birth, split.uncovered, free, dt_s)
        born = draw_births(births, window, velocity, self._key(_BIRTH), self._workers)
        moments = velocity_moments(self._particles, assignment, window.shape, self._workers)
        self._mass_each = resample(
            Candidates(self._particles, assignment, born, births),
            split.persistent,
            uniform(self._key(_RESAMPLE)),
            self._spare,
            self._workers,
        )
        self._particles, self._spare = self._spare, self._particles
        self._masses = posterior
        self._cycle += 1
        return GridMap(window, posterior, split, moments)

    def _follow(self, before: Window, window: Window, dt_s: float) -> None:
        """Predict the particles and move everything to the new window."""
        rows, cols = before.offset_to(window)
        shift_m = (-cols * window.cell_m, -rows * window.cell_m)
        motion = MotionStep.over(dt_s, shift_m, self.config.motion)
        count = self.config.particles
        self._workers.run(predict, count, self._particles, motion, self._key(_PREDICT))
        if self._window is None:
            self._masses = Masses.unknown(window.shape)
        self._masses = Masses(*(scrolled(mass, (rows, cols)) for mass in self._masses))
        self._window = window

    def _key(self, stage: int) -> np.uint64:
        return stream(self.config.seed, self._cycle, stage)

    def _check(self, measured: Masses, window: Window, dt_s: float) -> None:
        if not (np.isfinite(dt_s) and dt_s > 0):
            raise InputError("dt_s", dt_s, "a positive number of seconds")
        if measured.occupied.shape != window.shape or measured.free.shape != window.shape:
            raise InputError("shape of measured", measured.occupied.shape, f"{window.shape}")
        before = self._window
        if before is not None and (before.shape, before.cell_m) != (window.shape, window.cell_m):
            raise InputError("window", window, f"{before.shape} cells of {before.cell_m} m")

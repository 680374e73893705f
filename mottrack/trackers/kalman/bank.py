"""Which engine runs the filters: closed blocks, dense stacks, several models, or the reference."""

from __future__ import annotations

from typing import Protocol

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import ConfigError
from mottrack.trackers.kalman.block_bank import BlockBank
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.dense_bank import DenseBank
from mottrack.trackers.kalman.imm_bank import ImmBank


class Bank(Protocol):
    """N filters over the state of `mottrack.trackers.kalman.state`, D numbers each."""

    @property
    def size(self) -> int:
        """D."""
        ...

    @property
    def mean(self) -> F64:
        """(N, D) states."""
        ...

    @property
    def covariance(self) -> F64:
        """(N, D, D) covariances."""
        ...

    def __len__(self) -> int: ...

    def planar_covariance(self) -> F64:
        """(N, 4, 4) covariance of (x, y, d_x, d_y)."""
        ...

    def axial_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        ...

    def append(self, mean: F64, variance: F64, velocity_covariance: F64, model: I64) -> None:
        """Adds n tracks: mean and variance (n, D), velocity covariance (n, 2, 2), model (n,)."""
        ...

    def keep(self, mask: Mask) -> None:
        """Drops every track outside the mask (N,)."""
        ...

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advances by dt_s (N,) with process noise (N, 13) per unit of time."""
        ...

    def turn(self, rows: I64) -> None:
        """Turns the boxes of `rows` round by half a turn."""
        ...

    def update_box(self, rows: I64, residual: F64, position: F64, axial: F64) -> None:
        """Corrects `rows` (n,) by box residuals (n, 7).

        `position` (n, 2, 2) is the covariance of the observed x, y and `axial` (n, 5) are the
        variances of z, yaw, l, w, h.
        """
        ...

    def update_velocity(self, rows: I64, residual: F64, covariance: F64) -> None:
        """Corrects `rows` (n,) by velocity residuals (n, 2) with covariances (n, 2, 2)."""
        ...


def make_bank(config: KalmanConfig) -> Bank:
    """The engine that a configuration asks for.

    Raises:
        ConfigError: the engine cannot run the motion models that are asked for.
    """
    wiener, motion = config.noise.form == "wiener", config.motion
    models, engine = motion.models(), config.engine
    if engine in ("block", "filterpy") and models != ("cv",):
        raise ConfigError(f"engine {engine} runs motion cv alone, not {', '.join(models)}")
    if engine == "filterpy":
        # the reference pulls in scipy and matplotlib: loaded only by those who ask for it
        from mottrack.trackers.kalman.filterpy_bank import FilterpyBank

        return FilterpyBank(wiener=wiener)
    if motion.mixes():
        return ImmBank(models, motion.choices(), motion.switch_per_s, wiener=wiener)
    if engine == "dense" or models != ("cv",):
        return DenseBank(models, wiener=wiener)
    return BlockBank(wiener=wiener)

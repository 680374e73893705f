"""Interface of the filter banks, and the choice between them."""

from __future__ import annotations

from typing import Protocol

from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.kalman.block_bank import BlockBank
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.observations import Matched, Observation, SeenBoxes


class Bank(Protocol):
    """N constant-velocity filters over the state of `mottrack.trackers.kalman.state`."""

    @property
    def filters(self) -> tuple[F64, F64]:
        """(N, 11) states, and covariances (N, 4, 4) of (x, y, d_x, d_y)."""
        ...

    @property
    def z_yaw_size_variance(self) -> F64:
        """(N, 5) variances of z, yaw, l, w, h."""
        ...

    def __len__(self) -> int: ...

    def covariance(self, rows: I64) -> F64:
        """Return the covariances (n, 11, 11) of `rows` (n,), laid out in full."""
        ...

    def append(self, mean: F64, variance: F64, velocity_covariance: F64) -> None:
        """Add n tracks: mean and variance (n, 11), velocity covariance (n, 2, 2)."""
        ...

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        ...

    def predict(self, dt_s: F64, process: F64) -> None:
        """Advance by x <- F x, P <- F P F' + Q over dt_s (N,); process noise (N, 11) per unit."""
        ...

    def flip_heading(self, rows: I64) -> None:
        """Add pi to the headings of `rows`."""
        ...

    def update_box(self, matched: Matched, seen: SeenBoxes) -> None:
        """Correct the matched tracks by their boxes, whose headings are known modulo pi."""
        ...

    def update_yaw(self, rows: I64, residual: F64, variance: F64) -> None:
        """Correct the headings of `rows` (n,) by residuals (n,) with variances (n,)."""
        ...

    def update_velocity(self, rows: I64, velocity: Observation, weight: F64) -> None:
        """Correct `rows` (n,) by n velocities.

        `weight` (n,) is the probability that the velocity is correct: the result is the Gaussian of
        the same mean and covariance as the mixture of the corrected and the uncorrected state.
        """
        ...


def make_bank(config: KalmanConfig) -> Bank:
    """Return an empty bank of the engine that a configuration names."""
    wiener = config.noise.form == "wiener"
    if config.engine == "filterpy":
        # the reference imports scipy and matplotlib: loaded only where it is asked for
        from mottrack.trackers.kalman.filterpy_bank import FilterpyBank

        return FilterpyBank(wiener=wiener)
    return BlockBank(wiener=wiener)

"""Outlier statistics of a velocity source: errors beyond its covariance."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import DataError, InputError

PROBABILITIES = ("p_missed_motion", "p_missed_slow", "p_outlier")
"""Fields of `VelocityErrorModel` that add up to the probability of a failure at most."""


@dataclass(frozen=True, slots=True)
class VelocityErrorModel:
    """Errors of a velocity source that its covariance does not describe.

    Raises:
        InputError: a number is negative, a speed is not above 0, or the probabilities add up to 1
            or more.
    """

    relative: float = 0.0
    """Standard deviation along the velocity as a fraction of it: part of the cells was static."""
    p_missed_motion: float = 0.0
    """Probability that a moving object, however fast, is measured as static."""
    p_missed_slow: float = 0.0
    """What slow motion adds to it: at speed u this times exp(-u^2 / (2 missed_speed_mps^2))."""
    missed_speed_mps: float = 1.0
    """Speed over which `p_missed_slow` falls off."""
    p_outlier: float = 0.0
    """Probability that the velocity is another object's, or of nothing at all."""
    outlier_sigma_mps: float = 5.0
    """Standard deviation of such a velocity, of one axis."""
    class_variances: tuple[tuple[str, float], ...] = ()
    """R_d by class in (m/s)^2 of one axis, measured on training scenes; the entry "all" is that of
    the others. Empty: only each measurement's own covariance is known."""
    persistence: float = 0.0
    """Correlation of the errors of successive velocities of a mover: where an object looks the same
    in every frame the same part of it is misread."""

    def __post_init__(self) -> None:
        for name in ("relative", *PROBABILITIES):
            if not getattr(self, name) >= 0.0:
                raise InputError(name, getattr(self, name), "at least 0")
        if not 0.0 <= self.persistence < 1.0:
            raise InputError("persistence", self.persistence, "from 0 to below 1")
        for name in ("missed_speed_mps", "outlier_sigma_mps"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(name, getattr(self, name), "above 0, m/s")
        if sum(getattr(self, name) for name in PROBABILITIES) >= 1.0:
            shares = " + ".join(str(getattr(self, name)) for name in PROBABILITIES)
            raise InputError(" + ".join(PROBABILITIES), shares, "less than 1")

    @property
    def misses_motion(self) -> bool:
        """Whether the source ever measures a moving object as static."""
        return self.p_missed_motion + self.p_missed_slow > 0.0

    def repeated(self, number: I64) -> F64:
        """Return the factor on the covariance (n,) of velocities that `number` others preceded.

        Of errors that correlate by a from one velocity to the next, many tell as much as
        (1 - a) / (1 + a) times as many that are independent.
        """
        a = self.persistence
        return np.where(number > 0, (1.0 + a) / (1.0 - a), 1.0)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, as `read_error_models` reads it."""
        return asdict(self) | {"class_variances": dict(self.class_variances)}


NO_OUTLIERS = VelocityErrorModel()
"""A radar, a detector of known quality, the truth, and a source that nobody calibrated."""


def read_error_models(file: Path) -> dict[str, VelocityErrorModel]:
    """Return the error models of a JSON file by the name of their source.

    Raises:
        DataError: the file is missing or holds something else.
    """
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
        return {
            name: VelocityErrorModel(
                **entry | {"class_variances": tuple(entry["class_variances"].items())}
            )
            for name, entry in stored.items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        reason = f"unreadable ({error})"
        raise DataError(file, "content", reason, "what calibrate-errors writes") from error

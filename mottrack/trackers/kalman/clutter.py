"""Density of detections that no track explains, estimated by class while the tracker runs."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64
from mottrack.geometry.polygon import convex_area, monotone_chain
from mottrack.trackers.kalman.config import AssociationConfig

MIN_AREA_M2 = 500.0
"""Least area of a frame: the hull of a few detections says little of what the sensor covers."""


class ClutterDensity:
    """New and false detections per square metre of each class (lambda of the association).

    With `estimate_clutter` it is the posterior mean of a Poisson rate under a gamma prior,

        lambda_c = concentration (n_c + lambda_0 A_0) / (A + A_0),

    with n_c the detections of class c that no track took, A the area that the detections of each
    frame spanned, summed over frames, and A_0 that of `clutter_prior_frames` frames. Objects stand
    in groups, so the density around one of them is `clutter_concentration` times the average.
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._count, self._stated = np.zeros(0), np.zeros(0)
        self._area_m2 = 0.0

    def nll_gate(self, labels: list[str], area_m2: float) -> F64:
        """Return -2 ln lambda of each class (C,), above which a pair is refused.

        Args:
            labels: names of the class indices.
            area_m2: area that this step's detections span.
        """
        density = self.average_per_m2(labels, area_m2)
        if density is None:
            return np.full(len(labels), np.inf)
        if self._config.estimate_clutter:
            density = density * self._config.clutter_concentration
        gate: F64 = -2.0 * np.log(density)
        return gate

    def average_per_m2(self, labels: list[str], area_m2: float) -> F64 | None:
        """Return lambda of each class (C,) without the concentration; None where it is not used."""
        config = self._config
        default = config.clutter_density_per_m2
        if default is None:
            return None
        if len(self._stated) != len(labels):  # there are new classes
            by_class = config.class_clutter_density_per_m2
            self._stated = np.array([by_class.get(name, default) for name in labels])
            self._count = np.append(self._count, np.zeros(len(labels) - len(self._count)))
        density = self._stated
        if config.estimate_clutter:
            prior_m2 = config.clutter_prior_frames * area_m2
            density = (self._count + density * prior_m2) / (self._area_m2 + prior_m2)
        return density

    def record(self, label: I64, classes: int, area_m2: float) -> None:
        """Count the detections (n,) of a step that no track took; `label` are class indices."""
        count = np.bincount(label, minlength=classes).astype(np.float64)
        count[: len(self._count)] += self._count
        self._count = count
        self._area_m2 += area_m2


def spanned_area_m2(xy_m: F64) -> float:
    """Return the area of the convex hull of positions (N, 2), at least `MIN_AREA_M2`."""
    if len(xy_m) < 3:
        return MIN_AREA_M2
    # about the first, so that far coordinates cost no precision
    points = xy_m - xy_m[0]
    order = np.lexsort((points[:, 1], points[:, 0]))
    return max(_hull_area(points, order), MIN_AREA_M2)


@compiled
def _hull_area(points: F64, order: I64) -> float:
    hull = np.empty((2 * len(points) + 1, 2))
    return convex_area(hull, monotone_chain(points, order, hull))

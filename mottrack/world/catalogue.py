"""The kinds of movers: size, speed, and how they drive or walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TRACKED = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
"""The seven nuScenes tracking classes: what detectors report."""
UNKNOWN = ("animal", "ball", "debris")
"""Movers outside the ontology: in the truth, never detected."""


@dataclass(frozen=True)
class Kind:
    """One kind of mover; pairs are (mean, spread)."""

    length_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    speed: tuple[float, float]
    """Wished speed over the speed limit of the route."""
    acceleration_mps2: float
    braking_mps2: float
    gap_m: float
    """Distance kept at rest."""
    headway_s: float
    wheelbase: float
    """Axle distance over length; 0 turns on the spot."""
    sway_m: float
    """How far it wanders to the sides of its path."""


KINDS: dict[str, Kind] = {
    "car": Kind(
        (4.5, 0.35), (1.86, 0.09), (1.60, 0.16), (0.95, 0.12), 1.8, 2.2, 1.8, 1.4, 0.6, 0.15
    ),
    "truck": Kind(
        (8.0, 1.6), (2.45, 0.12), (3.2, 0.35), (0.85, 0.08), 0.9, 1.8, 2.5, 1.8, 0.6, 0.1
    ),
    "bus": Kind((11.5, 0.9), (2.55, 0.05), (3.2, 0.15), (0.8, 0.08), 0.9, 1.6, 2.5, 1.8, 0.52, 0.1),
    "trailer": Kind((10.5, 2.0), (2.5, 0.08), (3.6, 0.3), (0.8, 0.1), 0.5, 1.5, 3.0, 2.0, 0.7, 0.0),
    "motorcycle": Kind(
        (2.1, 0.15), (0.8, 0.06), (1.55, 0.08), (1.0, 0.12), 2.5, 2.8, 1.5, 1.2, 0.65, 0.3
    ),
    "bicycle": Kind(
        (1.75, 0.1), (0.62, 0.05), (1.7, 0.08), (0.7, 0.16), 0.8, 1.8, 1.0, 1.0, 0.6, 0.08
    ),
    "pedestrian": Kind(
        (0.65, 0.1), (0.65, 0.07), (1.72, 0.13), (0.85, 0.15), 0.8, 1.2, 0.4, 0.4, 0.0, 0.06
    ),
}


def draw_size(rng: np.random.Generator, label: str) -> tuple[float, float, float]:
    """Length, width, height of one mover, never further than 2.5 spreads from the mean."""
    kind = KINDS[label]
    pairs = (kind.length_m, kind.width_m, kind.height_m)
    length, width, height = (
        mean + spread * float(np.clip(rng.normal(), -2.5, 2.5)) for mean, spread in pairs
    )
    return length, width, height

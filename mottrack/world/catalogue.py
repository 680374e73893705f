"""The kinds of agents: size, speed, and how they drive or walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

TRACKED = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
"""The seven nuScenes tracking classes: what detectors report."""
UNKNOWN = ("animal", "ball", "debris")  # Agents outside the ontology: in the truth, never detected


class Size(NamedTuple):
    """Dimensions of a box in metres."""

    length: float
    width: float
    height: float


class Driver(NamedTuple):
    """Parameters of the Intelligent Driver Model."""

    acceleration_mps2: float
    """a, the maximum."""
    braking_mps2: float
    """b, the comfortable one."""
    gap_m: float
    """s_0, kept at rest."""
    headway_s: float
    """T"""


class Share(NamedTuple):
    """Distribution of a relative quantity."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class Kind:
    """One kind of agent."""

    mean_size: Size
    size_deviation: Size
    speed: Share
    """Desired speed over the speed limit of the route."""
    driver: Driver
    wheelbase: float
    """Distance of the axles over the length; 0 turns on the spot."""
    sway_m: float
    """Amplitude of its lateral oscillation about its path."""


# Sizes: about those of European vehicles (2.55 m is the widest that EU Directive 96/53 allows) and
# of nuScenes' boxes. Drivers: around Treiber, Hennecke and Helbing 2000, Table I (a = 0.73,
# b = 1.67, s_0 = 2, T = 1.6), with the brisker acceleration of town traffic; of heavy vehicles,
# cycles and people by eye. Limits of routes are those of roads.py: a pedestrian's 0.85 is of
# 1.6 m/s, so 1.36 m/s, a bicycle's 0.7 of 7 m/s, so 4.9 m/s, both usual means.
KINDS: dict[str, Kind] = {
    "car": Kind(
        Size(4.5, 1.86, 1.6), Size(0.35, 0.09, 0.16), Share(0.95, 0.12),
        Driver(1.8, 2.2, 1.8, 1.4), wheelbase=0.6, sway_m=0.15,
    ),
    "truck": Kind(
        Size(8.0, 2.45, 3.2), Size(1.6, 0.12, 0.35), Share(0.85, 0.08),
        Driver(0.9, 1.8, 2.5, 1.8), wheelbase=0.6, sway_m=0.1,
    ),
    "bus": Kind(
        Size(11.5, 2.55, 3.2), Size(0.9, 0.05, 0.15), Share(0.8, 0.08),
        Driver(0.9, 1.6, 2.5, 1.8), wheelbase=0.52, sway_m=0.1,
    ),
    "trailer": Kind(
        Size(10.5, 2.5, 3.6), Size(2.0, 0.08, 0.3), Share(0.8, 0.1),
        Driver(0.5, 1.5, 3.0, 2.0), wheelbase=0.7, sway_m=0.0,
    ),
    "motorcycle": Kind(
        Size(2.1, 0.8, 1.55), Size(0.15, 0.06, 0.08), Share(1.0, 0.12),
        Driver(2.5, 2.8, 1.5, 1.2), wheelbase=0.65, sway_m=0.3,
    ),
    "bicycle": Kind(
        Size(1.75, 0.62, 1.7), Size(0.1, 0.05, 0.08), Share(0.7, 0.16),
        Driver(0.8, 1.8, 1.0, 1.0), wheelbase=0.6, sway_m=0.08,
    ),
    "pedestrian": Kind(
        Size(0.65, 0.65, 1.72), Size(0.1, 0.07, 0.13), Share(0.85, 0.15),
        Driver(0.8, 1.2, 0.4, 0.4), wheelbase=0.0, sway_m=0.06,
    ),
}  # fmt: skip
_MOST_DEVIATIONS = 2.5  # Keeps extreme draws within what vehicles and people measure


def draw_size(rng: np.random.Generator, label: str) -> Size:
    """Draw the size of one agent."""
    kind, most = KINDS[label], _MOST_DEVIATIONS
    pairs = zip(kind.mean_size, kind.size_deviation, strict=True)
    return Size(
        *(mean + spread * float(np.clip(rng.normal(), -most, most)) for mean, spread in pairs)
    )

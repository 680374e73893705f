"""Walks along both sides of every road and puts up what stands there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mottrack.world.curves import place_beside
from mottrack.world.materials import ASPHALT
from mottrack.world.roads import Road, RoadNetwork
from mottrack.world.solids import BOX, SolidsBuilder
from mottrack.world.terrain import Terrain, height_here, touches


@dataclass
class Parked:
    """Vehicles that stand at the kerb: (x, y, yaw), label and size of each."""

    place: list[tuple[float, float, float]] = field(default_factory=list)
    label: list[str] = field(default_factory=list)
    size_m: list[tuple[float, float, float]] = field(default_factory=list)


@dataclass(frozen=True)
class Spot:
    """A place beside a road."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Verge:
    """One side of one road, and the solids being collected."""

    network: RoadNetwork
    road: Road
    side: int
    """+1 left, -1 right of the centre line."""
    terrain: Terrain
    build: SolidsBuilder
    parked: Parked
    rng: np.random.Generator

    def spot(self, s_m: float, beyond_m: float) -> Spot:
        """The place ``beyond_m`` behind the kerb (negative: on the carriageway)."""
        lateral = self.side * (self.road.profile.half_carriageway_m + beyond_m)
        centre = self.road.centre
        x, y, yaw = place_beside(centre.xy_m, centre.heading_rad, float(s_m), float(lateral))
        return Spot(x, y, height_here(self.terrain, x, y), yaw)

    def on_road(self, spot: Spot, reach_m: float = 0.4) -> bool:
        """Whether a thing of that reach would stand on a carriageway."""
        return bool(touches(self.terrain, ASPHALT, (spot.x_m, spot.y_m), float(reach_m)))

    def near_junction(self, s_m: float, margin_m: float) -> bool:
        """Whether arc length ``s_m`` lies in the area of the intersection."""
        reach = self.network.stop_distance_m
        return reach > 0 and abs(s_m - self.road.origin_s_m) < reach + margin_m

    def wall(
        self,
        ends: tuple[float, float],
        beyond_m: float,
        box: tuple[float, float],
        surface: tuple[int, float],
    ) -> bool:
        """Puts a box of (thickness, height) along the road between two arc lengths.

        Its front stands ``beyond_m`` behind the kerb. Nothing is put where it would reach onto a
        carriageway; returns whether it was put.
        """
        thickness, height = box
        middle = self.spot(0.5 * (ends[0] + ends[1]), beyond_m + 0.5 * thickness)
        half = 0.5 * (ends[1] - ends[0])
        probes = [self.spot(s, beyond_m) for s in np.linspace(ends[0], ends[1], 5)]
        if any(self.on_road(p, 0.8) for p in [*probes, middle]):
            return False
        low = min(p.z_m for p in probes) - 0.3
        centre = (middle.x_m, middle.y_m, 0.5 * (low + middle.z_m + height))
        tall = 0.5 * (middle.z_m + height - low)
        self.build.add(BOX, centre, (half, 0.5 * thickness, tall), middle.yaw_rad, surface)
        return True

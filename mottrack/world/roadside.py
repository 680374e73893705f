"""One side of a road: places along it, and the solids and parked vehicles collected there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.world.catalogue import Size
from mottrack.world.curves import Interval, Place, place_beside
from mottrack.world.materials import ASPHALT, Surface
from mottrack.world.roads import Road, RoadNetwork
from mottrack.world.solids import SolidsBuilder
from mottrack.world.terrain import Terrain, height_at, touches

_FOUNDATION_M = 0.3  # Depth of walls below the lowest ground, so that no beam passes under them
_WALL_CLEARANCE_M = 0.8


class ParkedVehicle(NamedTuple):
    """A vehicle that stands all the time."""

    place: Place
    label: str
    size_m: Size


@dataclass(frozen=True)
class Spot:
    """A place on the ground beside a road."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float

    def above(self, height_m: float) -> tuple[float, ...]:
        """Return (x, y, z) of the point ``height_m`` above the ground."""
        return self.x_m, self.y_m, self.z_m + height_m


@dataclass(frozen=True)
class RoadsideStrip:
    """One side of one road, and the solids being collected."""

    network: RoadNetwork
    road: Road
    side: int
    """+1 left, -1 right of the centre line."""
    terrain: Terrain
    build: SolidsBuilder
    parked: list[ParkedVehicle]
    rng: np.random.Generator

    def spot(self, s_m: float, beyond_m: float) -> Spot:
        """Return the place ``beyond_m`` behind the kerb (negative: on the carriageway)."""
        lateral = self.side * (self.road.profile.half_carriageway_m + beyond_m)
        centre = self.road.centre
        x, y, yaw = place_beside(centre.xy_m, centre.heading_rad, float(s_m), float(lateral))
        terrain = self.terrain
        return Spot(x, y, height_at(terrain.height_m, terrain.frame, x, y), yaw)

    def on_road(self, spot: Spot, reach_m: float) -> bool:
        """Return whether a thing of that reach would stand on a carriageway."""
        return touches(self.terrain, ASPHALT, (spot.x_m, spot.y_m), float(reach_m))

    def near_junction(self, s_m: float, margin_m: float) -> bool:
        """Return whether arc length ``s_m`` lies in the area of the intersection."""
        reach = self.network.stop_distance_m
        return reach > 0 and abs(s_m - self.road.origin_s_m) < reach + margin_m

    def on_terrain(self) -> Interval:
        """Return the part of the road that lies on the terrain."""
        (x0, y0, per_m), shape = self.terrain.frame, self.terrain.height_m.shape
        xy = self.road.centre.xy_m
        inside = (xy[:, 0] > x0) & (xy[:, 0] < x0 + shape[1] / per_m)
        inside &= (xy[:, 1] > y0) & (xy[:, 1] < y0 + shape[0] / per_m)
        rows = np.flatnonzero(inside)
        return Interval(0.5 * rows[0], 0.5 * rows[-1]) if len(rows) else Interval(0.0, 0.0)

    def park(self, spot: Spot, yaw_rad: float, label: str, size_m: Size) -> None:
        """Add a parked vehicle."""
        self.parked.append(ParkedVehicle(Place(spot.x_m, spot.y_m, yaw_rad), label, size_m))

    def wall(
        self, ends: Interval, beyond_m: float, thickness: float, height: float, surface: Surface
    ) -> bool:
        """Add a box along the road, its front ``beyond_m`` behind the kerb.

        Returns:
            Whether it was added: not where it would reach onto a carriageway.
        """
        middle = self.spot(0.5 * (ends.start_m + ends.end_m), beyond_m + 0.5 * thickness)
        half = 0.5 * ends.length_m
        probes = [self.spot(s, beyond_m) for s in np.linspace(*ends, 5)]
        if any(self.on_road(p, _WALL_CLEARANCE_M) for p in [*probes, middle]):
            return False
        low = min(p.z_m for p in probes) - _FOUNDATION_M
        centre = (middle.x_m, middle.y_m, 0.5 * (low + middle.z_m + height))
        tall = 0.5 * (middle.z_m + height - low)
        self.build.add_box(centre, (half, 0.5 * thickness, tall), surface, middle.yaw_rad)
        return True

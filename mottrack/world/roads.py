"""Roads: centre lines, lanes, an intersection, pavements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64
from mottrack.world.curves import STEP_M, Curve, connection, curve_from_curvature, curve_through

APPROACHES = 4
NO_SIGNAL = -1
CYCLE_LANE, PAVEMENT = -1, -2  # Numbers of lanes that vehicles do not use
_STRAIGHT_M = 30.0  # Around the origin, where roads may cross, they are straight
_KNOT_M, _TRANSITION_M = 60.0, 20.0
"""Distance over which curvature changes, and over which the first bend begins."""
_CROSS_ROAD_M = 160.0  # Further away a crossing road is out of sight
_STOP_MARGIN_M = 3.0  # Room for a crossing between the stop line and the cross road
_CYCLE_MPS, _WALK_MPS = 7.0, 1.6
"""Brisk cyclists and walkers, for whom desired speeds are shares of these."""


@dataclass(frozen=True)
class Profile:
    """Cross-section of a road, the same on both sides."""

    lanes: int
    """Lanes in each direction."""
    lane_width_m: float
    median_m: float
    cycle_lane_m: float
    parking_m: float
    pavement_m: float
    speed_limit_mps: float

    @property
    def half_carriageway_m(self) -> float:
        """From the centre line to the kerb."""
        driven = self.median_m / 2 + self.lanes * self.lane_width_m
        return driven + self.cycle_lane_m + self.parking_m

    @property
    def half_m(self) -> float:
        """From the centre line to the line of the buildings' front gardens."""
        return self.half_carriageway_m + self.pavement_m

    def lane_m(self, index: int) -> float:
        """Return the middle of a lane to the right of the centre line; 0 is the innermost."""
        return self.median_m / 2 + (index + 0.5) * self.lane_width_m


@dataclass(frozen=True)
class Road:
    """A road whose centre line passes the origin at arc length ``origin_s_m``."""

    centre: Curve
    origin_s_m: float
    profile: Profile

    def directed(self, direction: int) -> tuple[Curve, float]:
        """Return the centre line in a direction (0 or 1) and its arc length at the origin."""
        if direction == 0:
            return self.centre, self.origin_s_m
        return self.centre.reversed(), self.centre.length_m - self.origin_s_m

    def parallel(self, direction: int, lateral_m: float) -> tuple[Curve, float]:
        """Return the line ``lateral_m`` right of the centre and its arc length at the origin."""
        line, origin = self.directed(direction)
        curve = line.offset(-lateral_m)
        there = line.at(np.array([origin]), np.zeros(1))[0, :2]
        return curve, int(np.argmin(np.hypot(*(curve.xy_m - there).T))) * STEP_M


class LaneKey(NamedTuple):
    """A lane of the network."""

    road: int
    direction: int
    """0 or 1: along or against the centre line."""
    lane: int
    """0 is the innermost; or CYCLE_LANE, PAVEMENT."""

    @property
    def approach(self) -> int:
        """The traffic light that holds for this direction of this road."""
        return 2 * self.road + self.direction


@dataclass(frozen=True)
class Route:
    """A path that agents follow."""

    curve: Curve
    kind: str
    """``drive``, ``cycle``, ``walk`` or ``cross``."""
    speed_limit_mps: float
    stop_m: float
    """Arc length of the stop line; inf where there is none."""
    approach: int
    """Which signal holds at the stop line."""
    lane: LaneKey
    """At the start: routes of one lane share their beginning."""


@dataclass(frozen=True)
class RoadNetwork:
    """One road, or two that cross at the origin."""

    roads: tuple[Road, ...]
    routes: tuple[Route, ...]
    kind: str
    """``motorway``, ``urban`` or ``residential``."""

    @property
    def stop_distance_m(self) -> float:
        """Distance of the stop lines from the origin; 0 without an intersection."""
        if len(self.roads) < 2:
            return 0.0
        return max(road.profile.half_m for road in self.roads) + _STOP_MARGIN_M


def build_network(rng: np.random.Generator, kind: str, reach_m: float) -> RoadNetwork:
    """Build a network whose main road extends ``reach_m`` either way from the origin."""
    # deviation of the curvature: radii around 700, 250 and 125 m
    bend = {"motorway": 0.0015, "urban": 0.004, "residential": 0.008}[kind]
    roads = [_road(rng, _profile(rng, kind), 0.0, reach_m, bend)]
    if kind != "motorway" and rng.random() < 0.85:  # most scenes have an intersection
        crossing = np.deg2rad(rng.uniform(65.0, 115.0))
        roads.append(_road(rng, _profile(rng, kind), crossing, min(reach_m, _CROSS_ROAD_M), bend))
    network = RoadNetwork(tuple(roads), (), kind)
    return replace(network, routes=tuple(_routes(network)))


def _profile(rng: np.random.Generator, kind: str) -> Profile:
    """Draw a cross-section.

    Widths lie about those of design guides: lanes 3.5 to 3.75 m on motorways and 2.75 to 3.5 m in
    towns, cycle lanes 1.6 m, parking 2 to 2.3 m, pavements from 1.5 m. Limits: 80 to 130, 40 to 65
    and 25 to 43 km/h. How often which occurs is chosen by eye.
    """
    if kind == "motorway":
        width, speed = float(rng.uniform(3.5, 3.8)), float(rng.uniform(22.0, 36.0))
        lanes, median = int(rng.integers(2, 5)), float(rng.uniform(1.5, 6.0))
        # the hard shoulder takes the place of parking, its soft edge that of a pavement
        return Profile(lanes, width, median, 0.0, 2.5, 1.5, speed)
    if kind == "residential":
        parking = 2.2 if rng.random() < 0.75 else 0.0
        width, speed = float(rng.uniform(2.8, 3.4)), float(rng.uniform(7.0, 12.0))
        return Profile(1, width, 0.0, 0.0, parking, float(rng.uniform(1.5, 3.0)), speed)
    lanes = int(rng.choice([1, 2, 2, 3]))
    cycle = 1.6 if rng.random() < 0.5 else 0.0
    parking = 2.3 if rng.random() < 0.6 else 0.0
    median = float(rng.choice([0.0, 0.0, 1.0, 3.0]))
    width, speed = float(rng.uniform(3.1, 3.6)), float(rng.uniform(11.0, 18.0))
    return Profile(lanes, width, median, cycle, parking, float(rng.uniform(2.5, 6.0)), speed)


def _road(
    rng: np.random.Generator, profile: Profile, heading_rad: float, reach_m: float, bend: float
) -> Road:
    ahead = curve_from_curvature(_curvature(rng, reach_m, bend), heading_rad)
    back = curve_from_curvature(_curvature(rng, reach_m, bend), heading_rad + np.pi)
    points = np.concatenate([back.xy_m[::-1], ahead.xy_m[1:]])
    return Road(curve_through(points), back.length_m, profile)


def _curvature(rng: np.random.Generator, reach_m: float, bend_per_m: float) -> F64:
    """Draw curvature per step: straight near the origin, then bends that come and go smoothly."""
    s = np.arange(0.0, reach_m, STEP_M)
    knots = np.arange(0.0, reach_m + _KNOT_M, _KNOT_M)
    values = rng.normal(0.0, bend_per_m, len(knots)) * (knots > _STRAIGHT_M)
    begun = np.clip((s - _STRAIGHT_M) / _TRANSITION_M, 0.0, 1.0)
    curvature: F64 = np.interp(s, knots, values) * begun
    return curvature


def _routes(network: RoadNetwork) -> list[Route]:
    routes: list[Route] = []
    for index, road in enumerate(network.roads):
        for direction in (0, 1):
            for lane in range(road.profile.lanes):
                routes += _lane_routes(network, LaneKey(index, direction, lane))
            if road.profile.cycle_lane_m > 0:
                routes.append(_cycle_route(network, LaneKey(index, direction, CYCLE_LANE)))
            if network.kind != "motorway":
                routes += _walks(network, LaneKey(index, direction, PAVEMENT))
    return routes


def _lane_routes(network: RoadNetwork, lane: LaneKey) -> list[Route]:
    profile = network.roads[lane.road].profile
    curve, origin = network.roads[lane.road].parallel(lane.direction, profile.lane_m(lane.lane))
    stop = origin - network.stop_distance_m if len(network.roads) > 1 else np.inf
    straight = Route(curve, "drive", profile.speed_limit_mps, stop, lane.approach, lane)
    routes = [straight]
    if len(network.roads) > 1 and lane.lane == 0:
        routes.append(_turning(network, straight, left=True))
    if len(network.roads) > 1 and lane.lane == profile.lanes - 1:
        routes.append(_turning(network, straight, left=False))
    return routes


def _turning(network: RoadNetwork, straight: Route, *, left: bool) -> Route:
    """Return the route that turns from a lane of one road into the other road."""
    lane = straight.lane
    other = network.roads[1 - lane.road]
    into = lane.direction if left == (lane.road == 0) else 1 - lane.direction
    number = 0 if left else other.profile.lanes - 1
    curve, origin = other.parallel(into, other.profile.lane_m(number))
    before = straight.curve.part(0.0, straight.stop_m + 1.0)
    after = curve.part(origin + network.stop_distance_m - 1.0, curve.length_m)
    start = np.append(before.xy_m[-1], before.heading_rad[-1])
    bend = connection(start, np.append(after.xy_m[0], after.heading_rad[0]))
    points = np.concatenate([before.xy_m[:-1], bend, after.xy_m[1:]])
    return replace(straight, curve=curve_through(points))


def _cycle_route(network: RoadNetwork, lane: LaneKey) -> Route:
    road = network.roads[lane.road]
    p = road.profile
    lateral = p.median_m / 2 + p.lanes * p.lane_width_m + p.cycle_lane_m / 2
    curve, origin = road.parallel(lane.direction, lateral)
    stop = origin - network.stop_distance_m if len(network.roads) > 1 else np.inf
    return Route(curve, "cycle", _CYCLE_MPS, stop, lane.approach, lane)


def _walks(network: RoadNetwork, lane: LaneKey) -> list[Route]:
    """Return pavements on the right, before and behind the intersection, and a crossing."""
    road, crossed = network.roads[lane.road], len(network.roads) > 1
    middle = road.profile.half_carriageway_m + 0.6 * road.profile.pavement_m
    curve, origin = road.parallel(lane.direction, middle)
    gap = network.stop_distance_m + 0.5 if crossed else 0.0
    pieces = [curve.part(0.0, origin - gap), curve.part(origin + gap, curve.length_m)]
    ways = [("walk", NO_SIGNAL, c) for c in [*pieces, *(c.reversed() for c in pieces)]]
    line, s = road.directed(lane.direction)
    s += max(gap - 2.5, 0.0) + 8.0 * (gap == 0)  # between stop line and intersection
    x, y, heading = line.at(np.array([s]), np.zeros(1))[0]
    reach = np.linspace(-middle, middle, 60)[:, None]
    across = np.array([x, y]) + reach * np.array([-np.sin(heading), np.cos(heading)])
    approach = APPROACHES if crossed else NO_SIGNAL
    ways += [("cross", approach, curve_through(points)) for points in (across, across[::-1])]
    return [Route(c, kind, _WALK_MPS, np.inf, signal, lane) for kind, signal, c in ways]

"""Roads: centre lines, lanes, an intersection, pavements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.world.curves import (
    STEP_M,
    Curve,
    curve_from_curvature,
    curve_through,
    turn,
)
from mottrack.world.signals import NO_SIGNAL

APPROACHES = 4
_STRAIGHT_M = 30.0


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
        """Middle of a lane to the right of the centre line; 0 is the innermost."""
        return self.median_m / 2 + (index + 0.5) * self.lane_width_m


@dataclass(frozen=True)
class Road:
    """A road whose centre line passes the origin at arc length ``origin_s_m``."""

    centre: Curve
    origin_s_m: float
    profile: Profile


@dataclass(frozen=True)
class Route:
    """A way that movers follow."""

    curve: Curve
    kind: str
    """``drive``, ``cycle``, ``walk`` or ``cross``."""
    speed_limit_mps: float
    stop_m: float
    """Arc length of the stop line; inf where there is none."""
    approach: int
    """Which signal holds at the stop line: 2 * road + direction."""
    lane: tuple[int, int, int]
    """(road, direction, lane) at the start: routes of one lane share their beginning."""


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
        return max(road.profile.half_m for road in self.roads) + 3.0


def build_network(rng: np.random.Generator, kind: str, reach_m: float) -> RoadNetwork:
    """A network of that kind whose main road extends ``reach_m`` either way from the origin."""
    bend = {"motorway": 0.0015, "urban": 0.004, "residential": 0.008}[kind]
    roads = [_road(rng, _profile(rng, kind), (0.0, reach_m, bend))]
    if kind != "motorway" and rng.random() < 0.85:
        crossing = np.deg2rad(rng.uniform(65.0, 115.0))
        roads.append(_road(rng, _profile(rng, kind), (crossing, min(reach_m, 160.0), bend)))
    network = RoadNetwork(tuple(roads), (), kind)
    return RoadNetwork(tuple(roads), tuple(_routes(network)), kind)


def _profile(rng: np.random.Generator, kind: str) -> Profile:
    if kind == "motorway":
        width, speed = rng.uniform(3.5, 3.8), rng.uniform(22.0, 36.0)
        lanes, median = int(rng.integers(2, 5)), rng.uniform(1.5, 6.0)
        return Profile(lanes, float(width), float(median), 0.0, 2.5, 1.5, float(speed))
    if kind == "residential":
        parking = 2.2 if rng.random() < 0.75 else 0.0
        width, speed = rng.uniform(2.8, 3.4), rng.uniform(7.0, 12.0)
        return Profile(
            1, float(width), 0.0, 0.0, parking, float(rng.uniform(1.5, 3.0)), float(speed)
        )
    lanes = int(rng.choice([1, 2, 2, 3]))
    cycle = 1.6 if rng.random() < 0.5 else 0.0
    parking = 2.3 if rng.random() < 0.6 else 0.0
    median = float(rng.choice([0.0, 0.0, 1.0, 3.0]))
    width, speed = float(rng.uniform(3.1, 3.6)), float(rng.uniform(11.0, 18.0))
    return Profile(lanes, width, median, cycle, parking, float(rng.uniform(2.5, 6.0)), speed)


def _road(rng: np.random.Generator, profile: Profile, line: tuple[float, float, float]) -> Road:
    heading, reach, bend = line
    ahead = curve_from_curvature(_curvature(rng, reach, bend), heading)
    back = curve_from_curvature(_curvature(rng, reach, bend), heading + np.pi)
    points = np.concatenate([back.xy_m[::-1], ahead.xy_m[1:]])
    return Road(curve_through(points), back.length_m, profile)


def _curvature(rng: np.random.Generator, reach_m: float, bend_per_m: float) -> F64:
    """Straight near the origin, then bends that come and go smoothly."""
    s = np.arange(0.0, reach_m, STEP_M)
    knots = np.arange(0.0, reach_m + 60.0, 60.0)
    values = rng.normal(0.0, bend_per_m, len(knots)) * (knots > _STRAIGHT_M)
    return np.asarray(np.interp(s, knots, values) * np.clip((s - _STRAIGHT_M) / 20.0, 0.0, 1.0))


def _routes(network: RoadNetwork) -> list[Route]:
    routes: list[Route] = []
    for index, road in enumerate(network.roads):
        for direction in (0, 1):
            for lane in range(road.profile.lanes):
                routes += _lane_routes(network, (index, direction, lane))
            if road.profile.cycle_lane_m > 0:
                routes.append(_cycle_route(network, index, direction))
            routes += _walks(network, index, direction)
    return routes


def directed(road: Road, direction: int, lateral_m: float) -> tuple[Curve, float]:
    """(curve, arc length next to the origin) of the line ``lateral_m`` right of the centre."""
    line = road.centre if direction == 0 else road.centre.reversed()
    origin = road.origin_s_m if direction == 0 else road.centre.length_m - road.origin_s_m
    curve = line.offset(-lateral_m)
    near = int(
        np.argmin(np.hypot(*(curve.xy_m - line.at(np.array([origin]), np.zeros(1))[0, :2]).T))
    )
    return curve, near * STEP_M


def _lane_routes(network: RoadNetwork, lane: tuple[int, int, int]) -> list[Route]:
    index, direction, number = lane
    road = network.roads[index]
    curve, origin = directed(road, direction, road.profile.lane_m(number))
    limit, approach = road.profile.speed_limit_mps, 2 * index + direction
    if len(network.roads) < 2:
        return [Route(curve, "drive", limit, np.inf, approach, lane)]
    stop = origin - network.stop_distance_m
    routes = [Route(curve, "drive", limit, stop, approach, lane)]
    if number == 0:
        routes.append(_turning(network, lane, (curve, stop), left=True))
    if number == road.profile.lanes - 1:
        routes.append(_turning(network, lane, (curve, stop), left=False))
    return routes


def _turning(
    network: RoadNetwork, lane: tuple[int, int, int], entry: tuple[Curve, float], *, left: bool
) -> Route:
    """The route that turns from a lane of one road into the other road."""
    index, direction, _ = lane
    other = network.roads[1 - index]
    into = (
        (direction if left else 1 - direction)
        if index == 0
        else (1 - direction if left else direction)
    )
    number = 0 if left else other.profile.lanes - 1
    curve, origin = directed(other, into, other.profile.lane_m(number))
    before = entry[0].part(0.0, entry[1] + 1.0)
    after = curve.part(origin + network.stop_distance_m - 1.0, curve.length_m)
    start = np.append(before.xy_m[-1], before.heading_rad[-1])
    bend = turn(start, np.append(after.xy_m[0], after.heading_rad[0]))
    points = np.concatenate([before.xy_m[:-1], bend, after.xy_m[1:]])
    road = network.roads[index]
    limit, approach = road.profile.speed_limit_mps, 2 * index + direction
    return Route(curve_through(points), "drive", limit, entry[1], approach, lane)


def _cycle_route(network: RoadNetwork, index: int, direction: int) -> Route:
    road = network.roads[index]
    p = road.profile
    lateral = p.median_m / 2 + p.lanes * p.lane_width_m + p.cycle_lane_m / 2
    curve, origin = directed(road, direction, lateral)
    stop = origin - network.stop_distance_m if len(network.roads) > 1 else np.inf
    return Route(curve, "cycle", 7.0, stop, 2 * index + direction, (index, direction, -1))


def _walks(network: RoadNetwork, index: int, direction: int) -> list[Route]:
    """Pavements on the right of one direction, before and behind the intersection; a crossing."""
    road = network.roads[index]
    if network.kind == "motorway":
        return []
    middle = road.profile.half_carriageway_m + 0.6 * road.profile.pavement_m
    curve, origin = directed(road, direction, middle)
    lane = (index, direction, -2)
    gap = network.stop_distance_m + 0.5 if len(network.roads) > 1 else 0.0
    pieces = [curve.part(0.0, origin - gap), curve.part(origin + gap, curve.length_m)]
    walks = [Route(c, "walk", 1.6, np.inf, NO_SIGNAL, lane) for c in pieces]
    walks += [Route(c.reversed(), "walk", 1.6, np.inf, NO_SIGNAL, lane) for c in pieces]
    line = road.centre if direction == 0 else road.centre.reversed()
    s = road.origin_s_m if direction == 0 else road.centre.length_m - road.origin_s_m
    x, y, heading = line.at(np.array([s + max(gap - 2.5, 0.0) + 8.0 * (gap == 0)]), np.zeros(1))[0]
    reach = np.linspace(-middle, middle, 60)[:, None]
    across = np.array([x, y]) + reach * np.array([-np.sin(heading), np.cos(heading)])
    both = [curve_through(across), curve_through(across[::-1])]
    approach = APPROACHES if len(network.roads) > 1 else NO_SIGNAL
    return walks + [Route(c, "cross", 1.6, np.inf, approach, lane) for c in both]

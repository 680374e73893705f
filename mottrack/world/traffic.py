"""Who is on the roads when a scene begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64, Texts
from mottrack.world.catalogue import KINDS, draw_size
from mottrack.world.curves import Paths, stack
from mottrack.world.placement import first_come
from mottrack.world.roads import RoadNetwork, Route

_VEHICLES = ("car", "truck", "bus", "trailer", "motorcycle")
_SHARES = {
    "motorway": (0.76, 0.08, 0.02, 0.11, 0.03),
    "urban": (0.85, 0.05, 0.04, 0.01, 0.05),
    "residential": (0.91, 0.05, 0.01, 0.0, 0.03),
}


@dataclass(frozen=True)
class Density:
    """How busy a scene is; 1 is an ordinary day."""

    vehicles: float = 1.0
    pedestrians: float = 1.0
    parked: float = 1.0
    unknown: float = 1.0
    mid_turn: bool = False
    """Whether vehicles may stand inside the intersection when the scene begins; from all sides at
    once, so it is for short scenes, in which nobody waits for them to sort themselves out."""


@dataclass(frozen=True)
class Traffic:
    """N movers that follow routes; row 0 is the ego vehicle."""

    label: Texts
    size_m: F64
    """(N, 3)"""
    path: I64
    """(N,) route that it follows."""
    start_m: F64
    """(N,) arc length of its reference point at time 0."""
    speed_mps: F64
    """(N,) at time 0."""
    wish: F64
    """(N,) wished speed over the limit of the route."""
    lateral_m: F64
    """(N,) to the left of the route."""
    sway: F64
    """(N, 3) amplitude in metres, wave length in metres, phase."""
    driver: F64
    """(N, 5) acceleration, braking, gap, headway, distance of the axles."""
    towed_by: I64
    """(N,) the mover that pulls it, -1 for all but trailers."""
    paths: Paths
    routes: tuple[Route, ...]


@dataclass
class _Draft:
    label: str
    size_m: tuple[float, float, float]
    path: int
    s_m: float
    speed_mps: float
    wish: float
    lateral_m: float
    sway: tuple[float, float, float]
    tows: _Draft | None = None


def populate(
    rng: np.random.Generator, network: RoadNetwork, density: Density, ego_start_m: float
) -> Traffic:
    """Fills the lanes, the pavements and the crossings.

    Args:
        rng: where the draws come from.
        network: the roads.
        density: how busy.
        ego_start_m: way of the ego vehicle to the origin.
    """
    drafts = [_ego(rng, network, ego_start_m)]
    lanes = sorted({r.lane for r in network.routes if r.kind == "drive"})
    for lane in lanes:
        drafts += _fill_lane(rng, network, lane, density)
    if density.mid_turn:
        drafts += _turners(rng, network)
    for number, route in enumerate(network.routes):
        if route.kind == "cycle":
            drafts += _fill_sparsely(rng, network, number, ("bicycle", 70.0 / density.vehicles))
        elif route.kind == "walk":
            drafts += _fill_sparsely(
                rng, network, number, ("pedestrian", 26.0 / density.pedestrians)
            )
        elif route.kind == "cross":
            drafts += _fill_sparsely(
                rng, network, number, ("pedestrian", 12.0 / density.pedestrians)
            )
    return _assemble(network, _without_overlaps(network, drafts))


def _without_overlaps(network: RoadNetwork, drafts: list[_Draft]) -> list[_Draft]:
    """Leaves out who would stand in somebody else; a trailer goes with its truck."""
    places = []
    for d in drafts:
        s = d.s_m + 0.5 * KINDS[d.label].wheelbase * d.size_m[0]
        places.append(network.routes[d.path].curve.at(np.array([s]), np.array([d.lateral_m]))[0])
    party = np.arange(len(drafts))
    towed = np.flatnonzero([d.label == "trailer" for d in drafts])
    party[towed] -= 1
    keep = first_come(np.array(places), np.array([d.size_m for d in drafts]), party)
    both = keep[towed] & keep[towed - 1]
    keep[towed], keep[towed - 1] = both, both
    return [d for d, stays in zip(drafts, keep, strict=True) if stays]


def _ego(rng: np.random.Generator, network: RoadNetwork, ego_start_m: float) -> _Draft:
    choices = [
        i for i, r in enumerate(network.routes) if r.kind == "drive" and r.lane[:2] == (0, 0)
    ]
    path = int(rng.choice(choices))
    road = network.roads[0]
    s = max(road.origin_s_m - ego_start_m, 20.0)
    share = 0.0 if rng.random() < 0.12 else rng.uniform(0.1, 1.0)
    speed = float(network.routes[path].speed_limit_mps * share)
    return _Draft("car", (4.6, 1.85, 1.6), path, float(s), speed, 0.95, 0.0, (0.1, 60.0, 0.0))


@dataclass(frozen=True)
class _Flow:
    """How a lane moves."""

    pace_mps: float
    spread_mps: float
    """Speeds of single vehicles lie up to so much higher; some then stand."""
    gap_m: float


def _flow(rng: np.random.Generator, limit_mps: float, density: float) -> _Flow:
    """Free, slow, creeping, or stop and go."""
    kind = str(rng.choice(["free", "slow", "creep", "jam"], p=[0.66, 0.12, 0.09, 0.13]))
    if kind == "jam":
        return _Flow(0.0, 4.0, 2.5)
    if kind == "creep":
        return _Flow(float(rng.uniform(0.2, 2.5)), 0.0, 3.0)
    pace = limit_mps * float(rng.uniform(0.5, 1.05) if kind == "free" else rng.uniform(0.12, 0.4))
    return _Flow(pace, 0.0, (11.0 + 1.6 * pace + float(rng.exponential(18.0))) / density)


def _fill_lane(
    rng: np.random.Generator, network: RoadNetwork, lane: tuple[int, int, int], density: Density
) -> list[_Draft]:
    routes = [i for i, r in enumerate(network.routes) if r.kind == "drive" and r.lane == lane]
    route = network.routes[routes[0]]
    flow, jam = _flow(rng, route.speed_limit_mps, density.vehicles), _Flow(0.0, 3.0, 2.0)
    queue = rng.random() < 0.4
    s, end = float(rng.uniform(0.0, flow.gap_m)), route.curve.length_m
    drafts: list[_Draft] = []
    while s < end - 10.0:
        waits = queue and route.stop_m - 60.0 < s < route.stop_m - 3.0
        now = jam if waits else flow
        draft = _vehicle(rng, network, (routes, s, now))
        draft.s_m = s = s + draft.size_m[0] + (draft.tows.size_m[0] if draft.tows else 0.0)
        if draft.tows:
            _hitch(draft, draft.tows)
        into = draft.s_m + 0.5 * draft.size_m[0] - network.routes[draft.path].stop_m
        if density.mid_turn or not 0.0 < into < 2.0 * network.stop_distance_m + 12.0:
            drafts += [draft, draft.tows] if draft.tows else [draft]
        s += 1.5 + float(rng.exponential(now.gap_m)) + 1.0 * now.pace_mps
    return drafts


def _turners(rng: np.random.Generator, network: RoadNetwork) -> list[_Draft]:
    """Vehicles that are in the middle of a turn when the scene begins."""
    drafts: list[_Draft] = []
    for number, route in enumerate(network.routes):
        bends = route.kind == "drive" and np.ptp(route.curve.heading_rad) > 0.8
        if bends and np.isfinite(route.stop_m) and rng.random() < 0.4:
            s = route.stop_m + float(rng.uniform(-2.0, 22.0))
            draft = _vehicle(rng, network, ([number], s, _Flow(0.0, 7.0, 0.0)))
            if draft.tows is None:
                drafts.append(draft)
    return drafts


def _vehicle(
    rng: np.random.Generator, network: RoadNetwork, place: tuple[list[int], float, _Flow]
) -> _Draft:
    routes, s, flow = place
    label = str(rng.choice(_VEHICLES, p=_SHARES[network.kind]))
    usable = [r for r in routes if s < network.routes[r].stop_m + 1.0] or routes[:1]
    weights = np.array([0.6 if r == routes[0] else 0.4 for r in usable])
    path = int(rng.choice(usable, p=weights / weights.sum()))
    kind = KINDS[label]
    wish = max(kind.speed[0] + kind.speed[1] * float(rng.normal()), 0.5)
    drift = 0.45 if rng.random() < 0.1 else kind.sway_m * float(rng.uniform(0.2, 1.0))
    sway = (drift, float(rng.uniform(40, 90)), float(rng.uniform(0, 6)))
    speed = min(flow.pace_mps, network.routes[path].speed_limit_mps) * wish
    if flow.spread_mps > 0:
        speed = max(float(rng.uniform(-0.5, 1.0)), 0.0) * flow.spread_mps
    lateral = float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3))
    size = draw_size(rng, label)
    draft = _Draft(label, size, path, s, speed, wish, lateral, sway)
    if label == "trailer":
        tractor = (float(rng.uniform(5.6, 6.4)), 2.5, float(rng.uniform(3.0, 3.7)))
        return _Draft("truck", tractor, path, s, speed, wish, lateral, (0.0, 50.0, 0.0), draft)
    return draft


def _hitch(truck: _Draft, trailer: _Draft) -> None:
    """Puts a trailer behind its truck: its axle runs on the same path, so it cuts corners."""
    rear = truck.s_m - 0.5 * truck.size_m[0] * (1.0 - KINDS["truck"].wheelbase)
    middle = rear - 0.3 - 0.5 * trailer.size_m[0]
    trailer.s_m = middle - 0.5 * KINDS["trailer"].wheelbase * trailer.size_m[0]
    trailer.sway = truck.sway


def _fill_sparsely(
    rng: np.random.Generator, network: RoadNetwork, path: int, what: tuple[str, float]
) -> list[_Draft]:
    label, spacing = what
    route = network.routes[path]
    s, drafts = float(rng.exponential(spacing)), list[_Draft]()
    while s < route.curve.length_m - 1.0:
        pavement = network.roads[route.lane[0]].profile.pavement_m
        draft = _person(rng, label, (path, s, 0.38 * pavement), route)
        drafts.append(draft)
        s += 1.2 + float(rng.exponential(spacing))
    return drafts


def _person(
    rng: np.random.Generator, label: str, place: tuple[int, float, float], route: Route
) -> _Draft:
    """Somebody on foot or on a bicycle: keeps to the right, or stands at the side."""
    path, s, room = place
    kind = KINDS[label]
    standing = route.kind == "walk" and rng.random() < 0.25
    wish = max(kind.speed[0] + kind.speed[1] * float(rng.normal()), 0.4)
    reach = 1.4 if route.kind == "cross" else max(min(0.9, room), 0.4)
    lateral = (
        -float(rng.uniform(0.35, reach)) if label == "pedestrian" else float(rng.uniform(-0.3, 0.3))
    )
    speed = wish * route.speed_limit_mps
    if standing:
        wish, speed, lateral = 0.0, 0.0, float(rng.choice([-room, room]))
    if route.kind == "cross":
        speed, s = (0.0, 0.2) if s < 3.0 else (speed, s)
    sway = (kind.sway_m * (not standing), float(rng.uniform(15, 30)), float(rng.uniform(0, 6)))
    return _Draft(label, draw_size(rng, label), path, s, speed, wish, lateral, sway)


def _assemble(network: RoadNetwork, drafts: list[_Draft]) -> Traffic:
    def driver(draft: _Draft) -> list[float]:
        kind = KINDS[draft.label]
        base = kind.wheelbase * draft.size_m[0]
        return [kind.acceleration_mps2, kind.braking_mps2, kind.gap_m, kind.headway_s, base]

    return Traffic(
        label=np.array([d.label for d in drafts]),
        size_m=np.array([d.size_m for d in drafts]),
        path=np.array([d.path for d in drafts]),
        start_m=np.array([d.s_m for d in drafts]),
        speed_mps=np.array([d.speed_mps for d in drafts]),
        wish=np.array([d.wish for d in drafts]),
        lateral_m=np.array([d.lateral_m for d in drafts]),
        sway=np.array([d.sway for d in drafts]),
        driver=np.array([driver(d) for d in drafts]),
        towed_by=np.array([i - 1 if d.label == "trailer" else -1 for i, d in enumerate(drafts)]),
        paths=stack([r.curve for r in network.routes]),
        routes=network.routes,
    )

"""Who is on the roads when a scene begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mottrack.datasets.synthetic.catalogue import KINDS, draw_size
from mottrack.datasets.synthetic.curves import Paths, stack
from mottrack.datasets.synthetic.roads import RoadNetwork, Route

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


@dataclass(frozen=True)
class Traffic:
    """N movers that follow routes; row 0 is the ego vehicle."""

    label: NDArray[np.str_]
    size_m: NDArray[np.float64]
    """(N, 3)"""
    path: NDArray[np.int64]
    """(N,) route that it follows."""
    start_m: NDArray[np.float64]
    """(N,) arc length of its reference point at time 0."""
    speed_mps: NDArray[np.float64]
    """(N,) at time 0."""
    wish: NDArray[np.float64]
    """(N,) wished speed over the limit of the route."""
    lateral_m: NDArray[np.float64]
    """(N,) to the left of the route."""
    sway: NDArray[np.float64]
    """(N, 3) amplitude in metres, wave length in metres, phase."""
    driver: NDArray[np.float64]
    """(N, 5) acceleration, braking, gap, headway, distance of the axles."""
    towed_by: NDArray[np.int64]
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
        drafts += _fill_lane(rng, network, lane, (density.vehicles, drafts[0]))
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
    return _assemble(network, drafts)


def _ego(rng: np.random.Generator, network: RoadNetwork, ego_start_m: float) -> _Draft:
    choices = [
        i for i, r in enumerate(network.routes) if r.kind == "drive" and r.lane[:2] == (0, 0)
    ]
    path = int(rng.choice(choices))
    road = network.roads[0]
    s = max(road.origin_s_m - ego_start_m, 20.0)
    speed = network.routes[path].speed_limit_mps * rng.uniform(0.3, 1.0)
    return _Draft(
        "car", (4.6, 1.85, 1.6), path, float(s), float(speed), 0.95, 0.0, (0.1, 60.0, 0.0)
    )


def _fill_lane(
    rng: np.random.Generator,
    network: RoadNetwork,
    lane: tuple[int, int, int],
    context: tuple[float, _Draft],
) -> list[_Draft]:
    density, ego = context
    routes = [i for i, r in enumerate(network.routes) if r.kind == "drive" and r.lane == lane]
    limit = network.routes[routes[0]].speed_limit_mps
    flow = limit * float(rng.choice([0.15, 0.5, 0.8, 1.0], p=[0.15, 0.2, 0.3, 0.35]))
    spacing = (8.0 + 1.6 * flow + float(rng.exponential(18.0))) / density
    s, end = float(rng.uniform(0.0, spacing)), network.routes[routes[0]].curve.length_m
    drafts: list[_Draft] = []
    while s < end - 10.0:
        draft = _vehicle(rng, network, (routes, s, flow))
        behind = draft.size_m[0] + (draft.tows.size_m[0] if draft.tows else 0.0)
        draft.s_m = s = s + behind
        if draft.tows:
            _hitch(draft, draft.tows)
        same_lane = network.routes[ego.path].lane == lane
        if not (same_lane and abs(s - ego.s_m) < behind + 8.0):
            drafts += [draft, draft.tows] if draft.tows else [draft]
        s += 3.0 + float(rng.exponential(spacing)) + 0.6 * flow
    return drafts


def _vehicle(
    rng: np.random.Generator, network: RoadNetwork, place: tuple[list[int], float, float]
) -> _Draft:
    routes, s, flow = place
    label = str(rng.choice(_VEHICLES, p=_SHARES[network.kind]))
    usable = [r for r in routes if s < network.routes[r].stop_m - 25.0] or routes[:1]
    weights = np.array([0.6 if r == routes[0] else 0.4 for r in usable])
    path = int(rng.choice(usable, p=weights / weights.sum()))
    kind = KINDS[label]
    wish = max(kind.speed[0] + kind.speed[1] * float(rng.normal()), 0.5)
    sway = (
        kind.sway_m * float(rng.uniform(0.2, 1.0)),
        float(rng.uniform(40, 90)),
        float(rng.uniform(0, 6)),
    )
    speed = min(flow, network.routes[path].speed_limit_mps) * wish
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

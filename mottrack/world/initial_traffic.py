"""Initial traffic: vehicles, cyclists and pedestrians on the routes of a network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.world.catalogue import KINDS, Size, draw_size
from mottrack.world.config import DensityConfig
from mottrack.world.curves import stack
from mottrack.world.roads import LaneKey, RoadNetwork, Route
from mottrack.world.traffic import Agents, Sway, Traffic

_VEHICLES = ("car", "truck", "bus", "trailer", "motorcycle")
_SHARES = {  # of the vehicles, by eye; trailers stand for tractors with semi-trailers
    "motorway": (0.76, 0.08, 0.02, 0.11, 0.03),
    "urban": (0.85, 0.05, 0.04, 0.01, 0.05),
    "residential": (0.91, 0.05, 0.01, 0.0, 0.03),
}
_SPACING_M = {"cycle": 70.0, "walk": 26.0, "cross": 12.0}
"""Mean distance of cyclists and pedestrians on routes of that kind at density 1; by eye."""
_SLACK_M = 0.15  # Least gap between agents when a scene begins
_TURN_RAD = 0.8  # 45 degrees: a route that bends by more turns at the intersection


class Start(NamedTuple):
    """How a scene begins."""

    ego_m: float
    """Distance of the ego vehicle from the origin."""
    mid_turn: bool
    """Whether vehicles may stand inside the intersection; from all sides at once, so it is for
    short scenes, which end before they would have to clear it."""
    ego: str = "any"
    """How the ego vehicle drives: ``any``, ``turning`` (in the middle of a turn) or ``fast``."""


@dataclass
class _Draft:
    label: str
    size_m: Size
    path: int
    s_m: float
    speed_mps: float
    desired: float
    """Desired speed over the limit."""
    lateral_m: float
    sway: Sway
    tows: _Draft | None = None

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return KINDS[self.label].wheelbase * self.size_m.length


def populate(
    rng: np.random.Generator,
    network: RoadNetwork,
    density: DensityConfig,
    start: Start,
) -> Traffic:
    """Fill the lanes, the pavements and the crossings.

    Args:
        rng: source of the draws.
        network: the roads.
        density: how busy.
        start: where the ego vehicle is and what is going on.
    """
    drafts = [_EGOS[start.ego](rng, network, start.ego_m)]
    for lane in sorted({r.lane for r in network.routes if r.kind == "drive"}):
        drafts += _fill_lane(rng, network, lane, density.vehicles, mid_turn=start.mid_turn)
    if start.mid_turn:
        drafts += _turners(rng, network)
    for number, route in enumerate(network.routes):
        if route.kind != "drive":
            busy = density.vehicles if route.kind == "cycle" else density.pedestrians
            drafts += _fill_sparsely(rng, network, number, _SPACING_M[route.kind] / busy)
    return _assemble(network, _without_overlaps(network, drafts))


def _without_overlaps(network: RoadNetwork, drafts: list[_Draft]) -> list[_Draft]:
    """Drop overlapping agents; a trailer goes with its truck."""
    places = []
    for d in drafts:
        s = d.s_m + 0.5 * d.wheelbase_m
        places.append(network.routes[d.path].curve.at(np.array([s]), np.array([d.lateral_m]))[0])
    group = np.arange(len(drafts))
    towed = np.flatnonzero([d.label == "trailer" for d in drafts])
    group[towed] -= 1
    keep = _first_come(np.array(places), np.array([d.size_m for d in drafts]), group)
    both = keep[towed] & keep[towed - 1]
    keep[towed], keep[towed - 1] = both, both
    return [d for d, kept in zip(drafts, keep, strict=True) if kept]


def _first_come(place: F64, size_m: F64, group: I64) -> Mask:
    """Return (N,) which agents are kept: those that overlap no earlier one that is kept.

    Footprints are taken as three circles along their length. Members of one group may touch.

    Args:
        place: (N, 3) x, y, heading.
        size_m: (N, 3) length, width, height.
        group: (N,) number of the group.
    """
    radius = 0.55 * size_m[:, 1]  # a little over half the width: corners stick out of circles
    reach = np.maximum(0.5 * size_m[:, 0] - radius, 0.0)
    ahead = np.stack([np.cos(place[:, 2]), np.sin(place[:, 2])], axis=-1)
    steps = reach[:, None] * np.array([-1.0, 0.0, 1.0])
    circles = place[:, None, :2] + steps[..., None] * ahead[:, None]
    keep = np.ones(len(place), dtype=np.bool_)
    for i in range(1, len(place)):
        apart = circles[i][:, None, None, :] - circles[None, :i]
        gap = np.hypot(apart[..., 0], apart[..., 1]).min(axis=(0, 2)) - radius[i] - radius[:i]
        keep[i] = not (keep[:i] & (group[:i] != group[i]) & (gap < _SLACK_M)).any()
    return keep


def _ego(rng: np.random.Generator, network: RoadNetwork, ego_start_m: float) -> _Draft:
    choices = [
        i
        for i, r in enumerate(network.routes)
        if r.kind == "drive" and r.lane.road == r.lane.direction == 0
    ]
    path = int(rng.choice(choices))
    s = max(network.roads[0].origin_s_m - ego_start_m, 20.0)
    share = 0.0 if rng.random() < 0.12 else rng.uniform(0.1, 1.0)  # some scenes begin at rest
    speed = float(network.routes[path].speed_limit_mps * share)
    size = Size(4.6, 1.85, 1.6)  # a passenger car
    return _Draft("car", size, path, float(s), speed, 0.95, 0.0, Sway(0.1, 60.0, 0.0))


def _turning_ego(rng: np.random.Generator, network: RoadNetwork, ego_start_m: float) -> _Draft:
    """Draw an ego vehicle in the middle of a turn; any, where no route of the network turns."""
    draft = _ego(rng, network, ego_start_m)
    bends = [
        i
        for i, r in enumerate(network.routes)
        if r.kind == "drive"
        and np.isfinite(r.stop_m)
        and np.ptp(r.curve.heading_rad) > _TURN_RAD
        and r.lane.road == r.lane.direction == 0
    ]
    if not bends:
        return draft
    draft.path = int(rng.choice(bends))
    draft.s_m = network.routes[draft.path].stop_m + float(rng.uniform(0.0, 18.0))
    draft.speed_mps = float(rng.uniform(2.0, 8.0))
    return draft


def _fast_ego(rng: np.random.Generator, network: RoadNetwork, ego_start_m: float) -> _Draft:
    """Draw an ego vehicle near the limit of its road."""
    draft = _ego(rng, network, ego_start_m)
    draft.speed_mps = network.routes[draft.path].speed_limit_mps * float(rng.uniform(0.8, 1.1))
    return draft


_EGOS = {"any": _ego, "turning": _turning_ego, "fast": _fast_ego}


class _Flow(NamedTuple):
    """How a lane moves."""

    pace_mps: float
    spread_mps: float
    """Speeds of single vehicles lie up to so much higher; some then stand."""
    gap_m: float


_QUEUE = _Flow(0.0, 3.0, 2.0)  # At a red light


def _flow(rng: np.random.Generator, limit_mps: float, density: float) -> _Flow:
    """Draw how a lane moves: freely, slowly, creeping, or stop and go; shares by eye."""
    kind = str(rng.choice(["free", "slow", "creep", "jam"], p=[0.66, 0.12, 0.09, 0.13]))
    if kind == "jam":
        return _Flow(0.0, 4.0, 2.5)
    if kind == "creep":
        return _Flow(float(rng.uniform(0.2, 2.5)), 0.0, 3.0)
    pace = limit_mps * float(rng.uniform(0.5, 1.05) if kind == "free" else rng.uniform(0.12, 0.4))
    # a headway of 1.6 s (Treiber et al. 2000), vehicles of some length, and random gaps
    return _Flow(pace, 0.0, (11.0 + 1.6 * pace + float(rng.exponential(18.0))) / density)


def _fill_lane(
    rng: np.random.Generator, network: RoadNetwork, lane: LaneKey, density: float, *, mid_turn: bool
) -> list[_Draft]:
    routes = [i for i, r in enumerate(network.routes) if r.kind == "drive" and r.lane == lane]
    route = network.routes[routes[0]]
    flow = _flow(rng, route.speed_limit_mps, density)
    queue = rng.random() < 0.4
    s, end = float(rng.uniform(0.0, flow.gap_m)), route.curve.length_m
    drafts: list[_Draft] = []
    while s < end - 10.0:
        waits = queue and route.stop_m - 60.0 < s < route.stop_m - 3.0
        now = _QUEUE if waits else flow
        draft = _vehicle(rng, network, routes, s, now)
        draft.s_m = s = s + draft.size_m.length + (draft.tows.size_m.length if draft.tows else 0.0)
        if draft.tows:
            _hitch(draft, draft.tows)
        into = draft.s_m + 0.5 * draft.size_m.length - network.routes[draft.path].stop_m
        if mid_turn or not 0.0 < into < 2.0 * network.stop_distance_m + 12.0:
            drafts += [draft, draft.tows] if draft.tows else [draft]
        s += 1.5 + float(rng.exponential(now.gap_m)) + 1.0 * now.pace_mps
    return drafts


def _turners(rng: np.random.Generator, network: RoadNetwork) -> list[_Draft]:
    """Draw vehicles that are in the middle of a turn when the scene begins."""
    drafts: list[_Draft] = []
    for number, route in enumerate(network.routes):
        bends = route.kind == "drive" and np.ptp(route.curve.heading_rad) > _TURN_RAD
        if bends and np.isfinite(route.stop_m) and rng.random() < 0.4:
            s = route.stop_m + float(rng.uniform(-2.0, 22.0))
            draft = _vehicle(rng, network, [number], s, _Flow(0.0, 7.0, 0.0))
            if draft.tows is None:
                drafts.append(draft)
    return drafts


def _vehicle(
    rng: np.random.Generator, network: RoadNetwork, routes: list[int], s: float, flow: _Flow
) -> _Draft:
    """Draw a vehicle at ``s`` on one of the routes, the first of which goes straight on."""
    label = str(rng.choice(_VEHICLES, p=_SHARES[network.kind]))
    usable = [r for r in routes if s < network.routes[r].stop_m + 1.0] or routes[:1]
    weights = np.array([0.6 if r == routes[0] else 0.4 for r in usable])
    path = int(rng.choice(usable, p=weights / weights.sum()))
    kind = KINDS[label]
    desired = max(kind.speed.mean + kind.speed.deviation * float(rng.normal()), 0.5)
    # one in ten drifts within its lane
    drift = 0.45 if rng.random() < 0.1 else kind.sway_m * float(rng.uniform(0.2, 1.0))
    sway = Sway(drift, float(rng.uniform(40, 90)), float(rng.uniform(0, 6)))
    speed = min(flow.pace_mps, network.routes[path].speed_limit_mps) * desired
    if flow.spread_mps > 0:
        speed = max(float(rng.uniform(-0.5, 1.0)), 0.0) * flow.spread_mps
    lateral = float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3))
    size = draw_size(rng, label)
    draft = _Draft(label, size, path, s, speed, desired, lateral, sway)
    if label == "trailer":
        tractor = Size(float(rng.uniform(5.6, 6.4)), 2.5, float(rng.uniform(3.0, 3.7)))
        still = Sway(0.0, 50.0, 0.0)  # the trailer would have to follow it
        return _Draft("truck", tractor, path, s, speed, desired, lateral, still, draft)
    return draft


def _hitch(truck: _Draft, trailer: _Draft) -> None:
    """Put a trailer behind its truck: its axle runs on the same path, so it cuts corners."""
    rear = truck.s_m - 0.5 * truck.size_m.length * (1.0 - KINDS["truck"].wheelbase)
    middle = rear - 0.3 - 0.5 * trailer.size_m.length
    trailer.s_m = middle - 0.5 * KINDS["trailer"].wheelbase * trailer.size_m.length
    trailer.sway = truck.sway


def _fill_sparsely(
    rng: np.random.Generator, network: RoadNetwork, path: int, spacing_m: float
) -> list[_Draft]:
    """Draw cyclists or pedestrians along a route; they keep to the right or stand at its side."""
    route = network.routes[path]
    room = 0.38 * network.roads[route.lane.road].profile.pavement_m
    s, drafts = float(rng.exponential(spacing_m)), list[_Draft]()
    while s < route.curve.length_m - 1.0:
        drafts.append(_person(rng, route, path, s, room))
        s += 1.2 + float(rng.exponential(spacing_m))
    return drafts


def _person(rng: np.random.Generator, route: Route, path: int, s: float, room_m: float) -> _Draft:
    """Draw a cyclist, or a pedestrian, walking on the right or standing at the side."""
    label = "bicycle" if route.kind == "cycle" else "pedestrian"
    kind = KINDS[label]
    standing = route.kind == "walk" and rng.random() < 0.25
    desired = max(kind.speed.mean + kind.speed.deviation * float(rng.normal()), 0.4)
    speed = desired * route.speed_limit_mps
    if label == "pedestrian":
        reach = 1.4 if route.kind == "cross" else max(min(0.9, room_m), 0.4)
        lateral = -float(rng.uniform(0.35, reach))
    else:
        lateral = float(rng.uniform(-0.3, 0.3))
    if standing:
        desired, speed, lateral = 0.0, 0.0, float(rng.choice([-room_m, room_m]))
    if route.kind == "cross":
        speed, s = (0.0, 0.2) if s < 3.0 else (speed, s)  # on the kerb rather than just off it
    sway = Sway(kind.sway_m * (not standing), float(rng.uniform(15, 30)), float(rng.uniform(0, 6)))
    return _Draft(label, draw_size(rng, label), path, s, speed, desired, lateral, sway)


def _assemble(network: RoadNetwork, drafts: list[_Draft]) -> Traffic:
    routes = [network.routes[d.path] for d in drafts]
    drivers = [KINDS[d.label].driver for d in drafts]
    desired, limit = np.array([d.desired for d in drafts]), [r.speed_limit_mps for r in routes]
    agents = Agents(
        path=np.array([d.path for d in drafts]),
        size_m=np.array([d.size_m for d in drafts]),
        desired_mps=desired * np.array(limit),
        lateral_m=np.array([d.lateral_m for d in drafts]),
        sway_amplitude_m=np.array([d.sway.amplitude_m for d in drafts]),
        sway_wave_m=np.array([d.sway.wave_m for d in drafts]),
        sway_phase_rad=np.array([d.sway.phase_rad for d in drafts]),
        acceleration_mps2=np.array([d.acceleration_mps2 for d in drivers]),
        braking_mps2=np.array([d.braking_mps2 for d in drivers]),
        gap_m=np.array([d.gap_m for d in drivers]),
        headway_s=np.array([d.headway_s for d in drivers]),
        wheelbase_m=np.array([d.wheelbase_m for d in drafts]),
        stop_m=np.array([r.stop_m for r in routes]),
        approach=np.array([r.approach for r in routes]),
        towed_by=np.array([i - 1 if d.label == "trailer" else -1 for i, d in enumerate(drafts)]),
    )
    return Traffic(
        label=np.array([d.label for d in drafts]),
        agents=agents,
        start_m=np.array([d.s_m for d in drafts]),
        speed_mps=np.array([d.speed_mps for d in drafts]),
        paths=stack([r.curve for r in network.routes]),
        routes=network.routes,
    )

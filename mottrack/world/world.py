"""One world: roads, ground, what stands there, and who moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.world import street
from mottrack.world.bodies import Body, Troupe, gather, make_body
from mottrack.world.driving import Motion, simulate
from mottrack.world.ground import Extent, lay_ground
from mottrack.world.materials import Materials, material_table
from mottrack.world.roads import RoadNetwork, build_network
from mottrack.world.roadside import Parked, Verge
from mottrack.world.signals import random_signals
from mottrack.world.solids import Solids, SolidsBuilder, concatenate, select
from mottrack.world.staging import stage
from mottrack.world.states import States, join, resting, traffic_states
from mottrack.world.terrain import Terrain, heights_at
from mottrack.world.traffic import Density, Traffic, populate
from mottrack.world.unknown import Strays, draw_strays

_PLACES = ("urban", "residential", "motorway")


@dataclass(frozen=True)
class WorldPlan:
    """What to build."""

    place: str
    """``urban``, ``residential``, ``motorway`` or ``random``."""
    density: Density
    duration_s: float
    warm_up_s: float
    sight_m: float = 130.0
    """How far from the ego vehicle the world is filled."""


@dataclass(frozen=True)
class World:
    """A built world; movers are numbered traffic first (0 is the ego vehicle), parked, strays."""

    network: RoadNetwork
    terrain: Terrain
    materials: Materials
    static: Solids
    traffic: Traffic
    motion: Motion
    warm_up_s: float
    parked: States
    strays: Strays
    troupe: Troupe
    """Bodies of all movers but the ego vehicle, which the sensor on its roof does not see."""
    label: Texts
    size_m: F64

    def states(self, time_s: float) -> States:
        """All movers at a time of the scene."""
        driven = traffic_states(self.traffic, self.motion, time_s + self.warm_up_s)
        return join(join(driven, self.parked), self.strays.states(time_s))

    def floor_m(self, states: States) -> F64:
        """(N,) height of each mover's underside in the world."""
        return np.asarray(heights_at(self.terrain, states.xy_m) + states.lift_m)

    def solids(self, time_s: float, near_xy_m: F64, reach_m: float) -> Solids:
        """Everything within ``reach_m`` of a place, at a time."""
        states = self.states(time_s)
        moving = stage(self.troupe, states, self.floor_m(states))
        everything = concatenate([self.static, moving])
        away = np.hypot(*(everything.centre_m[:, :2] - near_xy_m).T)
        size = np.hypot(everything.half_m[:, 0], everything.half_m[:, 1])
        return select(everything, away - size < reach_m)


def build_world(rng: np.random.Generator, plan: WorldPlan) -> World:
    """Builds a world; the same generator state gives the same world."""
    place = plan.place
    if place == "random":
        place = str(rng.choice(_PLACES, p=[0.5, 0.3, 0.2]))
    fastest = {"urban": 14.0, "residential": 9.0, "motorway": 32.0}[place]
    way = fastest * plan.duration_s
    network = build_network(rng, place, plan.sight_m + 0.7 * way + 30.0)
    ego_start = float(rng.uniform(0.15, 0.7)) * way + float(rng.uniform(-20.0, 35.0))
    traffic = populate(rng, network, plan.density, ego_start)
    signals = random_signals(rng, 2 * len(network.roads))
    motion = simulate(traffic, signals, (-plan.warm_up_s, plan.duration_s + 0.2))
    terrain = lay_ground(rng, network, _extent(traffic, motion, plan.sight_m))
    static, parked = _line_roads(rng, network, terrain, plan.density)
    near = float(network.roads[0].origin_s_m - ego_start)
    strays = draw_strays(rng, network, 1.5 * plan.density.unknown, near)
    return _assemble(rng, (network, terrain, static), (traffic, motion, plan), (parked, strays))


def _extent(traffic: Traffic, motion: Motion, sight_m: float) -> Extent:
    """The area that the ego vehicle can see on its way."""
    route = traffic.routes[int(traffic.path[0])].curve
    xy = route.at(motion.s_m[:, 0], np.zeros(len(motion.s_m)))[:, :2]
    low, high = xy.min(axis=0) - sight_m, xy.max(axis=0) + sight_m
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _line_roads(
    rng: np.random.Generator, network: RoadNetwork, terrain: Terrain, density: Density
) -> tuple[Solids, Parked]:
    """Puts up what stands along the roads, within the terrain."""
    build, parked = SolidsBuilder(), Parked()
    for road in network.roads:
        for side in (1, -1):
            verge = Verge(network, road, side, terrain, build, parked, rng)
            span = _span_on_terrain(verge)
            if span[1] - span[0] < 10.0:
                continue
            if side == 1:
                street.median(verge, span)
            if side == 1 and rng.random() < (0.4 if network.kind == "motorway" else 0.08):
                street.bridge(verge, span)
            if network.kind == "motorway":
                street.motorway_verge(verge, span)
                continue
            share = float(rng.choice([0.0, 0.4, 0.7, 0.92])) * density.parked
            street.park_row(verge, span, share)
            street.furniture_strip(verge, span)
            back = road.profile.pavement_m
            line = street.building_line if _is_built_up(rng, network) else street.garden_line
            line(verge, span, back)
            street.doorsteps(verge, span, back)
            street.back_land(verge, span, back)
    return build.build(), parked


def _is_built_up(rng: np.random.Generator, network: RoadNetwork) -> bool:
    return bool(rng.random() < (0.7 if network.kind == "urban" else 0.15))


def _span_on_terrain(verge: Verge) -> tuple[float, float]:
    """First and last arc length of a road on the terrain."""
    (x0, y0, per_m), shape = verge.terrain.frame, verge.terrain.height_m.shape
    xy = verge.road.centre.xy_m
    inside = (xy[:, 0] > x0) & (xy[:, 0] < x0 + shape[1] / per_m)
    inside &= (xy[:, 1] > y0) & (xy[:, 1] < y0 + shape[0] / per_m)
    rows = np.flatnonzero(inside)
    return (0.5 * rows[0], 0.5 * rows[-1]) if len(rows) else (0.0, 0.0)


def _assemble(
    rng: np.random.Generator,
    scenery: tuple[RoadNetwork, Terrain, Solids],
    driving: tuple[Traffic, Motion, WorldPlan],
    extras: tuple[Parked, Strays],
) -> World:
    network, terrain, static = scenery
    traffic, motion, plan = driving
    parked, strays = extras
    parked_size = np.array(parked.size_m).reshape(len(parked.label), 3)
    label = np.concatenate([traffic.label, np.array(parked.label, dtype=np.str_), strays.label])
    size = np.concatenate([traffic.size_m, parked_size, strays.size_m])
    bodies = [make_body(rng, str(name), tuple(s)) for name, s in zip(label, size, strict=True)]
    place = np.array(parked.place).reshape(len(parked.label), 3)
    return World(
        network=network,
        terrain=terrain,
        materials=material_table(),
        static=static,
        traffic=traffic,
        motion=motion,
        warm_up_s=plan.warm_up_s,
        parked=resting(place[:, :2], place[:, 2]),
        strays=strays,
        troupe=_without_ego(bodies),
        label=label,
        size_m=size,
    )


def _without_ego(bodies: list[Body]) -> Troupe:
    troupe = gather(bodies)
    keep = troupe.solids.owner != 0
    return Troupe(select(troupe.solids, keep), troupe.swing_m[keep], troupe.stride_m[keep])

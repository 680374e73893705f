"""One world: roads, ground, roadside, traffic and parked vehicles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.world.bodies import Bodies, gather, make_body
from mottrack.world.catalogue import Size
from mottrack.world.config import DensityConfig
from mottrack.world.driving import Motion, random_signals, simulate
from mottrack.world.ground import Extent, build_ground
from mottrack.world.initial_traffic import Start, populate
from mottrack.world.materials import Materials, material_table
from mottrack.world.roads import build_network
from mottrack.world.roadside import ParkedVehicle, RoadsideStrip
from mottrack.world.solids import Solids, SolidsBuilder, concatenate, select
from mottrack.world.states import States, join, place_bodies, resting, traffic_states
from mottrack.world.street import line_road
from mottrack.world.terrain import Terrain, heights_at
from mottrack.world.traffic import Traffic
from mottrack.world.unknown import UnknownObjects, draw_unknown_objects

_PLACES = ("urban", "residential", "motorway")
_PLACE_SHARES = (0.5, 0.3, 0.2)
_FASTEST_MPS = {"urban": 14.0, "residential": 9.0, "motorway": 32.0}
"""Sets how long the roads are, a little under the highest limits of roads.py."""
_UNKNOWN_PER_SCENE = 1.5  # mean of a Poisson number: most scenes have one, some have none


@dataclass(frozen=True)
class WorldPlan:
    """What to build."""

    place: str
    """``urban``, ``residential``, ``motorway`` or ``random``."""
    density: DensityConfig
    duration_s: float
    warm_up_s: float
    """Simulated before the scene begins, so that traffic has settled."""
    sight_m: float = 130.0
    """How far from the ego vehicle the world is filled."""
    mid_turn: bool = False
    """Whether vehicles may be in the middle of a turn when the scene begins."""
    ego: str = "any"
    """How the ego vehicle drives when the scene begins, see `traffic.Start`."""


@dataclass(frozen=True)
class World:
    """A built world.

    Agents are numbered traffic first (0 is the ego vehicle), then parked vehicles, then unknown
    objects.
    """

    terrain: Terrain
    materials: Materials
    static: Solids
    traffic: Traffic
    motion: Motion
    warm_up_s: float
    parked: States
    unknown: UnknownObjects
    bodies: Bodies
    """Bodies of all agents but the ego vehicle, which the sensor on its roof does not see."""
    label: Texts
    size_m: F64

    def states(self, time_s: float) -> States:
        """Return the states of all agents at a time of the scene."""
        driven = traffic_states(self.traffic, self.motion, time_s + self.warm_up_s)
        return join([driven, self.parked, self.unknown.states(time_s)])

    def floor_m(self, states: States) -> F64:
        """Return (N,) the height of each agent's underside in the world."""
        return heights_at(self.terrain, states.xy_m) + states.lift_m

    def solids(self, time_s: float, near_xy_m: F64, reach_m: float) -> Solids:
        """Return everything within ``reach_m`` of a place, at a time."""
        states = self.states(time_s)
        moving = place_bodies(self.bodies, states, self.floor_m(states))
        everything = concatenate([self.static, moving])
        away = np.hypot(*(everything.centre_m[:, :2] - near_xy_m).T)
        size = np.hypot(everything.half_m[:, 0], everything.half_m[:, 1])
        return select(everything, away - size < reach_m)


def build_world(rng: np.random.Generator, plan: WorldPlan) -> World:
    """Build a world; the same generator state gives the same world."""
    place = plan.place
    if place == "random":
        place = str(rng.choice(_PLACES, p=_PLACE_SHARES))
    drive_m = _FASTEST_MPS[place] * plan.duration_s
    network = build_network(rng, place, plan.sight_m + 0.7 * drive_m + 30.0)
    # before the origin by most of the drive, so that an intersection is passed in most scenes
    ego_start = float(rng.uniform(0.15, 0.7)) * drive_m + float(rng.uniform(-20.0, 35.0))
    start = Start(ego_start, plan.mid_turn, plan.ego)
    traffic = populate(rng, network, plan.density, start)
    signals = random_signals(rng, 2 * len(network.roads))
    motion = simulate(traffic, signals, -plan.warm_up_s, plan.duration_s + 0.2)
    terrain = build_ground(rng, network, _extent(traffic, motion, plan.sight_m))
    build, parked = SolidsBuilder(), list[ParkedVehicle]()
    for road in network.roads:
        for side in (1, -1):
            strip = RoadsideStrip(network, road, side, terrain, build, parked, rng)
            line_road(strip, plan.density.parked)
    near = float(network.roads[0].origin_s_m - ego_start)
    mean_count = _UNKNOWN_PER_SCENE * plan.density.unknown
    unknown = draw_unknown_objects(rng, network, mean_count, near)
    parked_place = np.array([vehicle.place for vehicle in parked]).reshape(-1, 3)
    parked_size = np.array([vehicle.size_m for vehicle in parked]).reshape(-1, 3)
    parked_label = np.array([vehicle.label for vehicle in parked], dtype=np.str_)
    label = np.concatenate([traffic.label, parked_label, unknown.label])
    size = np.concatenate([traffic.agents.size_m, parked_size, unknown.size_m])
    return World(
        terrain=terrain,
        materials=material_table(),
        static=build.build(),
        traffic=traffic,
        motion=motion,
        warm_up_s=plan.warm_up_s,
        parked=resting(parked_place[:, :2], parked_place[:, 2]),
        unknown=unknown,
        bodies=_bodies(rng, label, size),
        label=label,
        size_m=size,
    )


def _extent(traffic: Traffic, motion: Motion, sight_m: float) -> Extent:
    """Return the area that the ego vehicle can see on its drive."""
    route = traffic.routes[int(traffic.agents.path[0])].curve
    xy = route.at(motion.s_m[:, 0], np.zeros(len(motion.s_m)))[:, :2]
    (x_min, y_min), (x_max, y_max) = xy.min(axis=0) - sight_m, xy.max(axis=0) + sight_m
    return Extent(float(x_min), float(x_max), float(y_min), float(y_max))


def _bodies(rng: np.random.Generator, label: Texts, size_m: F64) -> Bodies:
    bodies = gather(
        [make_body(rng, str(name), Size(*size)) for name, size in zip(label, size_m, strict=True)]
    )
    keep = bodies.solids.owner != 0
    return Bodies(select(bodies.solids, keep), bodies.swing_m[keep], bodies.stride_m[keep])

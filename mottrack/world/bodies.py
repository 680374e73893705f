"""The solids that agents are made of, in the frame of their own box.

Origin: middle of the footprint on the ground; x forward, y left, z up. Proportions are chosen by
eye from vehicles and people of usual build; they fill the box of the agent's size, as labels do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64
from mottrack.world.catalogue import Size
from mottrack.world.materials import CLOTH, FRAME, GLASS, PAINT, PLAIN, Surface
from mottrack.world.solids import BOX, CYLINDER, ELLIPSOID, Solids, SolidsBuilder, concatenate

# reflectance of black rubber and of a dirty underbody, chosen by eye
_RUBBER, _CHASSIS = Surface(PLAIN, 0.06), Surface(PLAIN, 0.1)
_LARGE_WHEEL_M, _CAR_WHEEL_M = 0.48, 0.31
"""Radius of tyres of the sizes 295/80 R 22.5 and 205/55 R 16."""


class Bodies(NamedTuple):
    """The bodies of one or N agents, and how their P parts swing when they walk."""

    solids: Solids
    """``owner`` is the agent, coordinates are in its frame."""
    swing_m: F64
    """(P,) amplitude forward and back."""
    stride_m: F64
    """(P,) distance of one full cycle of the legs; 0 where nothing swings."""


class _Room(NamedTuple):
    """Where a truck or trailer carries its load."""

    rear_m: float
    length_m: float
    width_m: float
    floor_m: float
    top_m: float


def make_body(rng: np.random.Generator, label: str, size_m: Size) -> Bodies:
    """Build the body of one agent of that label, filling a box of that size."""
    builder = SolidsBuilder()
    swing = _MAKERS[label](rng, builder, size_m)
    solids = builder.build()
    if swing is None:
        return Bodies(solids, np.zeros(len(solids.kind)), np.zeros(len(solids.kind)))
    return Bodies(solids, swing.amplitude_m, np.full(len(solids.kind), swing.stride_m))


def gather(bodies: list[Bodies]) -> Bodies:
    """Return all bodies in one table; the index in the list becomes the owner."""
    owner = np.repeat(np.arange(len(bodies)), [len(b.swing_m) for b in bodies])
    return Bodies(
        concatenate([b.solids for b in bodies])._replace(owner=owner),
        np.concatenate([b.swing_m for b in bodies]),
        np.concatenate([b.stride_m for b in bodies]),
    )


class _Swing(NamedTuple):
    amplitude_m: F64
    """(P,)"""
    stride_m: float


def _paint(rng: np.random.Generator) -> Surface:
    """Draw a colour: black returns little, white a lot."""
    albedo = rng.choice([0.06, 0.15, 0.3, 0.5, 0.75], p=[0.2, 0.25, 0.2, 0.1, 0.25])
    return Surface(PAINT, float(albedo))


def _cloth(rng: np.random.Generator, darkest: float, brightest: float) -> Surface:
    return Surface(CLOTH, float(rng.uniform(darkest, brightest)))


def _wheels(build: SolidsBuilder, size_m: Size, axles: tuple[float, ...], radius: float) -> None:
    """Add one box for the wheels of an axle: what lies between them is hardly ever seen."""
    half = (radius, 0.5 * size_m.width - 0.02, radius)
    for x in axles:
        build.add_box((x * size_m.length, 0.0, radius), half, _RUBBER)


def _car(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    """Add a lower body and a glazed cabin: saloon, estate, sport utility vehicle or van."""
    length, width, height = size_m
    paint = _paint(rng)
    waist = float(rng.uniform(0.54, 0.62)) * height
    belly = float(rng.uniform(0.16, 0.26))
    shape = str(rng.choice(["saloon", "estate", "van"], p=[0.45, 0.42, 0.13]))
    front = {"saloon": 0.24, "estate": 0.26, "van": 0.40}[shape] * length
    rear = {"saloon": -0.36, "estate": -0.485, "van": -0.495}[shape] * length
    cut = {"saloon": 0.55, "estate": 0.4, "van": 0.3}[shape]
    half = (0.5 * length, 0.5 * width, 0.5 * (waist - belly))
    build.add_box((0.0, 0.0, 0.5 * (waist + belly)), half, paint, chamfer_m=(0.28, 0.12))
    tall = 0.5 * (height - waist)
    cabin = (0.5 * (front - rear), 0.44 * width, tall)
    middle = 0.5 * (front + rear)
    glass = Surface(GLASS, 0.25)
    build.add_box((middle, 0.0, waist + tall), cabin, glass, chamfer_m=(0.1, cut))
    roof = (max(cabin[0] - cut, 0.3), 0.42 * width, 0.03)
    build.add_box((middle, 0.0, height - 0.03), roof, paint, chamfer_m=(0.1, 0.0))
    _wheels(build, size_m, (-0.3, 0.31), _CAR_WHEEL_M)
    plate = (-0.5 * length + 0.01, 0.0, 0.55 * waist + 0.2)  # retroreflecting
    build.add_box(plate, (0.02, 0.25, 0.06), Surface(PLAIN, 1.0))


def _truck(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    """Add a cab and a load: box, open bed or tank."""
    length, width, height = size_m
    paint = _paint(rng)
    cab = float(rng.uniform(1.8, 2.4))
    low = float(rng.uniform(0.45, 0.65))
    cab_top = min(height, float(rng.uniform(2.5, 3.1)))
    cab_x = 0.5 * length - 0.5 * cab
    waist = 0.55 * cab_top
    half = (0.5 * cab, 0.48 * width, 0.5 * (waist - low))
    build.add_box((cab_x, 0.0, 0.5 * (low + waist)), half, paint, chamfer_m=(0.2, 0.05))
    tall = 0.5 * (cab_top - waist)
    half = (0.5 * cab, 0.46 * width, tall)
    build.add_box((cab_x, 0.0, waist + tall), half, Surface(GLASS, 0.4), chamfer_m=(0.2, 0.3))
    _load(rng, build, _Room(-0.5 * length, length - cab - 0.4, width, low + 0.3, height))
    build.add_box((-0.2, 0.0, low + 0.15), (0.46 * length, 0.35 * width, 0.12), _CHASSIS)
    _wheels(build, size_m, (-0.36, -0.24, 0.36), _LARGE_WHEEL_M)


def _load(rng: np.random.Generator, build: SolidsBuilder, room: _Room) -> None:
    """Add the load of a truck or trailer."""
    rear, long, width, floor, top = room
    kind = str(rng.choice(["box", "box", "bed", "tank"]))
    colour = Surface(PAINT, float(rng.uniform(0.2, 0.85)))
    x = rear + 0.5 * long
    if kind == "bed":
        build.add_box((x, 0.0, floor + 0.3), (0.5 * long, 0.5 * width, 0.3), colour)
        heap = (0.45 * long, 0.4 * width, float(rng.uniform(0.2, 0.9)) * (top - floor - 0.6))
        build.add(ELLIPSOID, (x, 0.0, floor + 0.6), heap, Surface(CLOTH, 0.25))
        build.add_box((rear + 0.05, 0.0, top - 0.1), (0.05, 0.5 * width, 0.1), colour)
    else:
        tall = 0.5 * (top - floor)
        edges = (0.5, 0.0) if kind == "tank" else (0.0, 0.0)
        half = (0.5 * long, 0.5 * width, tall)
        build.add_box((x, 0.0, floor + tall), half, colour, chamfer_m=edges)


def _bus(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    length, width, height = size_m
    paint = _paint(rng)
    sill, roof = 1.15, height - 0.45
    layers = ((0.32, sill, paint), (sill, roof, Surface(GLASS, 0.3)), (roof, height, paint))
    for low, high, surface in layers:
        half = (0.5 * length, 0.5 * width, 0.5 * (high - low))
        build.add_box((0.0, 0.0, 0.5 * (low + high)), half, surface, chamfer_m=(0.15, 0.0))
    _wheels(build, size_m, (-0.28, 0.3), _LARGE_WHEEL_M)


def _trailer(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    length, width, height = size_m
    floor = float(rng.uniform(1.0, 1.3))
    _load(rng, build, _Room(-0.5 * length, length, width, floor, height))
    build.add_box((0.0, 0.0, floor - 0.12), (0.5 * length, 0.3 * width, 0.12), _CHASSIS)
    _wheels(build, size_m, (-0.4, -0.3, -0.2), _LARGE_WHEEL_M)


def _rider(build: SolidsBuilder, size_m: Size, saddle: float, cloth: Surface) -> None:
    """Add trunk, head and legs of a rider."""
    top, wide = size_m.height, min(0.24, 0.4 * size_m.width)
    trunk = 0.5 * (top - 0.24 - saddle)
    build.add(ELLIPSOID, (-0.12, 0.0, saddle + trunk), (0.2, wide, trunk + 0.08), cloth)
    build.add(ELLIPSOID, (0.0, 0.0, top - 0.14), (0.11, 0.1, 0.14), Surface(CLOTH, 0.3))
    for side in (-1.0, 1.0):
        legs = (0.05, side * 0.14, 0.5 * saddle + 0.12)
        build.add(CYLINDER, legs, (0.1, 0.07, 0.5 * saddle - 0.05), cloth)


def _bicycle(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    length, width, _ = size_m
    cloth = _cloth(rng, 0.08, 0.7)
    for x in (-0.3, 0.3):
        half = (0.2 * length, 0.03, 0.34)
        build.add(BOX, (x * length, 0.0, 0.34), half, Surface(FRAME, 0.2))
    build.add(BOX, (0.0, 0.0, 0.65), (0.2 * length, 0.03, 0.18), Surface(FRAME, 0.3))
    build.add(BOX, (0.3 * length, 0.0, 0.98), (0.03, 0.5 * width, 0.03), Surface(PLAIN, 0.2))
    _rider(build, size_m, 0.85, cloth)


def _motorcycle(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    length, width, _ = size_m
    cloth = _cloth(rng, 0.05, 0.4)
    for x in (-0.34, 0.34):
        half = (0.15 * length, 0.07, 0.31)
        build.add(BOX, (x * length, 0.0, 0.31), half, Surface(PLAIN, 0.08))
    tank = (0.3 * length, 0.17, 0.24)
    build.add_box((0.0, 0.0, 0.62), tank, _paint(rng), chamfer_m=(0.1, 0.1))
    build.add(BOX, (0.28 * length, 0.0, 1.02), (0.05, 0.5 * width, 0.08), Surface(PLAIN, 0.2))
    _rider(build, size_m, 0.78, cloth)


def _pedestrian(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> _Swing:
    """Add two legs that swing against each other, trunk, head, arms, sometimes a bag."""
    height = size_m.height
    cloth, trousers = _cloth(rng, 0.06, 0.75), _cloth(rng, 0.06, 0.75)
    hip = 0.47 * height
    for side in (-1.0, 1.0):
        build.add(CYLINDER, (0.0, side * 0.1, 0.5 * hip), (0.085, 0.075, 0.5 * hip), trousers)
    trunk = 0.5 * (0.86 * height - hip)
    build.add(ELLIPSOID, (0.0, 0.0, hip + trunk), (0.15, 0.21, trunk + 0.06), cloth)
    build.add(ELLIPSOID, (0.02, 0.0, height - 0.12), (0.1, 0.085, 0.12), Surface(CLOTH, 0.35))
    for side in (-1.0, 1.0):
        build.add(CYLINDER, (0.0, side * 0.25, hip + trunk), (0.055, 0.05, trunk), cloth)
    swing = [0.22, -0.22, 0.0, 0.0, -0.12, 0.12]
    if rng.random() < 0.25:
        build.add(BOX, (-0.18, 0.0, hip + trunk), (0.1, 0.16, 0.22), Surface(CLOTH, 0.3))
        swing.append(0.0)
    # two steps of 0.7 m at a height of 1.75 m
    return _Swing(np.array(swing) * height / 1.75, 0.8 * height)


def _animal(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> _Swing:
    length, width, height = size_m
    fur = _cloth(rng, 0.1, 0.6)
    trunk = (0.42 * length, 0.45 * width, 0.24 * height)
    build.add(ELLIPSOID, (0.0, 0.0, 0.68 * height), trunk, fur)
    head = (0.12 * length, 0.3 * width, 0.15 * height)
    build.add(ELLIPSOID, (0.37 * length, 0.0, 0.85 * height), head, fur)
    for x in (-0.3, 0.28):
        legs = (0.05, 0.3 * width, 0.25 * height)
        build.add(CYLINDER, (x * length, 0.0, 0.25 * height), legs, fur)
    return _Swing(np.array([0.0, 0.0, 0.12, -0.12]) * length, 0.9 * length)


def _ball(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    radius = 0.5 * size_m.height
    surface = Surface(PLAIN, float(rng.uniform(0.2, 0.8)))
    build.add(ELLIPSOID, (0.0, 0.0, radius), (radius, radius, radius), surface)


def _debris(rng: np.random.Generator, build: SolidsBuilder, size_m: Size) -> None:
    half = (0.5 * size_m.length, 0.5 * size_m.width, 0.5 * size_m.height)
    build.add(BOX, (0.0, 0.0, half[2]), half, Surface(PLAIN, float(rng.uniform(0.1, 0.7))))


_MAKERS: dict[str, Callable[[np.random.Generator, SolidsBuilder, Size], _Swing | None]] = {
    "car": _car, "truck": _truck, "bus": _bus, "trailer": _trailer, "bicycle": _bicycle,
    "motorcycle": _motorcycle, "pedestrian": _pedestrian, "animal": _animal, "ball": _ball,
    "debris": _debris,
}  # fmt: skip

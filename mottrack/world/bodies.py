"""The solids that movers are made of, in the frame of their own box.

Origin: middle of the footprint on the ground; x forward, y left, z up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.world.materials import CLOTH, FRAME, GLASS, PAINT, PLAIN
from mottrack.world.solids import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    Solids,
    SolidsBuilder,
    concatenate,
)

Size = tuple[float, float, float]


@dataclass(frozen=True)
class Body:
    """Parts of one mover in its own frame, and how they swing when it walks."""

    solids: Solids
    swing_m: F64
    """(P,) amplitude forward and back."""
    stride_m: float
    """Way of one full cycle of the legs; 0 where nothing swings."""


def _still(builder: SolidsBuilder) -> Body:
    solids = builder.build()
    return Body(solids, np.zeros(len(solids.kind)), 0.0)


def make_body(rng: np.random.Generator, label: str, size_m: Size) -> Body:
    """The body of one mover of that label, filling a box of that size."""
    return _MAKERS[label](rng, size_m)


def _paint(rng: np.random.Generator) -> tuple[int, float]:
    """Car colours: black returns little, white a lot."""
    return PAINT, float(rng.choice([0.06, 0.15, 0.3, 0.5, 0.75], p=[0.2, 0.25, 0.2, 0.1, 0.25]))


def _wheels(builder: SolidsBuilder, size_m: Size, axles: tuple[float, ...], radius: float) -> None:
    """One box for the wheels of an axle: what lies between them is hardly ever seen."""
    length, width, _ = size_m
    for x in axles:
        half = (radius, 0.5 * width - 0.02, radius)
        builder.add_box_with_cuts((x * length, 0.0, radius), half, (0.0, 0.0), (PLAIN, 0.06))


def _car(rng: np.random.Generator, size_m: Size) -> Body:
    """Lower body and a glazed cabin: saloon, estate, sport utility vehicle or van."""
    length, width, height = size_m
    paint, build = _paint(rng), SolidsBuilder()
    waist = float(rng.uniform(0.54, 0.62)) * height
    belly = float(rng.uniform(0.16, 0.26))
    shape = str(rng.choice(["saloon", "estate", "van"], p=[0.45, 0.42, 0.13]))
    front = {"saloon": 0.24, "estate": 0.26, "van": 0.40}[shape] * length
    rear = {"saloon": -0.36, "estate": -0.485, "van": -0.495}[shape] * length
    cut = {"saloon": 0.55, "estate": 0.4, "van": 0.3}[shape]
    middle = 0.5 * (waist + belly)
    half = (0.5 * length, 0.5 * width, 0.5 * (waist - belly))
    build.add_box_with_cuts((0.0, 0.0, middle), half, (0.28, 0.12), paint)
    tall = 0.5 * (height - waist)
    cabin = (0.5 * (front - rear), 0.44 * width, tall)
    at = (0.5 * (front + rear), 0.0, waist + tall)
    build.add_box_with_cuts(at, cabin, (0.1, cut), (GLASS, 0.25))
    roof = (max(cabin[0] - cut, 0.3), 0.42 * width, 0.03)
    build.add_box_with_cuts((at[0], 0.0, height - 0.03), roof, (0.1, 0.0), paint)
    _wheels(build, size_m, (-0.3, 0.31), 0.31)
    plate = (-0.5 * length + 0.01, 0.0, 0.55 * waist + 0.2)
    build.add_box_with_cuts(plate, (0.02, 0.25, 0.06), (0.0, 0.0), (PLAIN, 1.0))
    return _still(build)


def _truck(rng: np.random.Generator, size_m: Size) -> Body:
    """Cab and load: box, open bed or tank."""
    length, width, height = size_m
    build, paint = SolidsBuilder(), _paint(rng)
    cab = float(rng.uniform(1.8, 2.4))
    low = float(rng.uniform(0.45, 0.65))
    cab_top = min(height, float(rng.uniform(2.5, 3.1)))
    cab_x = 0.5 * length - 0.5 * cab
    waist = 0.55 * cab_top
    build.add_box_with_cuts(
        (cab_x, 0.0, 0.5 * (low + waist)),
        (0.5 * cab, 0.48 * width, 0.5 * (waist - low)),
        (0.2, 0.05),
        paint,
    )
    tall = 0.5 * (cab_top - waist)
    build.add_box_with_cuts(
        (cab_x, 0.0, waist + tall), (0.5 * cab, 0.46 * width, tall), (0.2, 0.3), (GLASS, 0.4)
    )
    _load(rng, build, (length - cab - 0.4, width, height), (-0.5 * length, low + 0.3))
    build.add_box_with_cuts(
        (-0.2, 0.0, low + 0.15), (0.46 * length, 0.35 * width, 0.12), (0.0, 0.0), (PLAIN, 0.1)
    )
    _wheels(build, size_m, (-0.36, -0.24, 0.36), 0.48)
    return _still(build)


def _load(
    rng: np.random.Generator, build: SolidsBuilder, room: Size, place: tuple[float, float]
) -> None:
    """The load of a truck: from ``place`` (rear end, floor) forward, within ``room``."""
    long, width, top = room
    rear, floor = place
    kind, colour = (
        str(rng.choice(["box", "box", "bed", "tank"])),
        (PAINT, float(rng.uniform(0.2, 0.85))),
    )
    x = rear + 0.5 * long
    if kind == "bed":
        build.add_box_with_cuts(
            (x, 0.0, floor + 0.3), (0.5 * long, 0.5 * width, 0.3), (0.0, 0.0), colour
        )
        heap = float(rng.uniform(0.2, 0.9)) * (top - floor - 0.6)
        build.add(
            ELLIPSOID, (x, 0.0, floor + 0.6), (0.45 * long, 0.4 * width, heap), 0.0, (CLOTH, 0.25)
        )
        top_bar = (rear + 0.05, 0.0, top - 0.1)
        build.add_box_with_cuts(top_bar, (0.05, 0.5 * width, 0.1), (0.0, 0.0), colour)
    elif kind == "tank":
        tall = 0.5 * (top - floor)
        build.add_box_with_cuts(
            (x, 0.0, floor + tall), (0.5 * long, 0.5 * width, tall), (0.5, 0.0), colour
        )
    else:
        tall = 0.5 * (top - floor)
        build.add_box_with_cuts(
            (x, 0.0, floor + tall), (0.5 * long, 0.5 * width, tall), (0.0, 0.0), colour
        )


def _bus(rng: np.random.Generator, size_m: Size) -> Body:
    length, width, height = size_m
    build, paint = SolidsBuilder(), _paint(rng)
    sill, roof = 1.15, height - 0.45
    for low, high, surface in (
        (0.32, sill, paint),
        (sill, roof, (GLASS, 0.3)),
        (roof, height, paint),
    ):
        half = (0.5 * length, 0.5 * width, 0.5 * (high - low))
        build.add_box_with_cuts((0.0, 0.0, 0.5 * (low + high)), half, (0.15, 0.0), surface)
    _wheels(build, size_m, (-0.28, 0.3), 0.48)
    return _still(build)


def _trailer(rng: np.random.Generator, size_m: Size) -> Body:
    length, width, height = size_m
    build = SolidsBuilder()
    floor = float(rng.uniform(1.0, 1.3))
    _load(rng, build, (length, width, height), (-0.5 * length, floor))
    build.add_box_with_cuts(
        (0.0, 0.0, floor - 0.12), (0.5 * length, 0.3 * width, 0.12), (0.0, 0.0), (PLAIN, 0.1)
    )
    _wheels(build, size_m, (-0.4, -0.3, -0.2), 0.48)
    return _still(build)


def _rider(build: SolidsBuilder, size_m: Size, saddle: float, cloth: tuple[int, float]) -> None:
    """Trunk, head and legs of somebody who rides."""
    top, wide = size_m[2], min(0.24, 0.4 * size_m[1])
    trunk = 0.5 * (top - 0.24 - saddle)
    build.add(ELLIPSOID, (-0.12, 0.0, saddle + trunk), (0.2, wide, trunk + 0.08), 0.0, cloth)
    build.add(ELLIPSOID, (0.0, 0.0, top - 0.14), (0.11, 0.1, 0.14), 0.0, (CLOTH, 0.3))
    for side in (-1.0, 1.0):
        legs = (0.05, side * 0.14, 0.5 * saddle + 0.12)
        build.add(CYLINDER, legs, (0.1, 0.07, 0.5 * saddle - 0.05), 0.0, cloth)


def _bicycle(rng: np.random.Generator, size_m: Size) -> Body:
    length, width, _ = size_m
    build, cloth = SolidsBuilder(), (CLOTH, float(rng.uniform(0.08, 0.7)))
    for x in (-0.3, 0.3):
        build.add(BOX, (x * length, 0.0, 0.34), (0.2 * length, 0.03, 0.34), 0.0, (FRAME, 0.2))
    build.add(BOX, (0.0, 0.0, 0.65), (0.2 * length, 0.03, 0.18), 0.0, (FRAME, 0.3))
    build.add(BOX, (0.3 * length, 0.0, 0.98), (0.03, 0.5 * width, 0.03), 0.0, (PLAIN, 0.2))
    _rider(build, size_m, 0.85, cloth)
    return _still(build)


def _motorcycle(rng: np.random.Generator, size_m: Size) -> Body:
    length, width, _ = size_m
    build, cloth = SolidsBuilder(), (CLOTH, float(rng.uniform(0.05, 0.4)))
    for x in (-0.34, 0.34):
        build.add(BOX, (x * length, 0.0, 0.31), (0.15 * length, 0.07, 0.31), 0.0, (PLAIN, 0.08))
    build.add_box_with_cuts((0.0, 0.0, 0.62), (0.3 * length, 0.17, 0.24), (0.1, 0.1), _paint(rng))
    build.add(BOX, (0.28 * length, 0.0, 1.02), (0.05, 0.5 * width, 0.08), 0.0, (PLAIN, 0.2))
    _rider(build, size_m, 0.78, cloth)
    return _still(build)


def _pedestrian(rng: np.random.Generator, size_m: Size) -> Body:
    """Two legs that swing against each other, trunk, arms, head, sometimes a bag."""
    height = size_m[2]
    cloth, trousers = ((CLOTH, float(rng.uniform(0.06, 0.75))) for _ in range(2))
    build, hip = SolidsBuilder(), 0.47 * height
    for side in (-1.0, 1.0):
        build.add(CYLINDER, (0.0, side * 0.1, 0.5 * hip), (0.085, 0.075, 0.5 * hip), 0.0, trousers)
    trunk = 0.5 * (0.86 * height - hip)
    build.add(ELLIPSOID, (0.0, 0.0, hip + trunk), (0.15, 0.21, trunk + 0.06), 0.0, cloth)
    build.add(ELLIPSOID, (0.02, 0.0, height - 0.12), (0.1, 0.085, 0.12), 0.0, (CLOTH, 0.35))
    for side in (-1.0, 1.0):
        build.add(CYLINDER, (0.0, side * 0.25, hip + trunk), (0.055, 0.05, trunk), 0.0, cloth)
    swing = [0.22, -0.22, 0.0, 0.0, -0.12, 0.12]
    if rng.random() < 0.25:
        build.add(BOX, (-0.18, 0.0, hip + trunk), (0.1, 0.16, 0.22), 0.0, (CLOTH, 0.3))
        swing.append(0.0)
    return Body(build.build(), np.array(swing) * height / 1.75, 0.8 * height)


def _animal(rng: np.random.Generator, size_m: Size) -> Body:
    length, width, height = size_m
    fur, build = (CLOTH, float(rng.uniform(0.1, 0.6))), SolidsBuilder()
    build.add(
        ELLIPSOID, (0.0, 0.0, 0.68 * height), (0.42 * length, 0.45 * width, 0.24 * height), 0.0, fur
    )
    build.add(
        ELLIPSOID,
        (0.37 * length, 0.0, 0.85 * height),
        (0.12 * length, 0.3 * width, 0.15 * height),
        0.0,
        fur,
    )
    for x in (-0.3, 0.28):
        build.add(
            CYLINDER, (x * length, 0.0, 0.25 * height), (0.05, 0.3 * width, 0.25 * height), 0.0, fur
        )
    return Body(build.build(), np.array([0.0, 0.0, 0.12, -0.12]) * length, 0.9 * length)


def _ball(rng: np.random.Generator, size_m: Size) -> Body:
    build, radius = SolidsBuilder(), 0.5 * size_m[2]
    build.add(
        ELLIPSOID,
        (0.0, 0.0, radius),
        (radius, radius, radius),
        0.0,
        (PLAIN, float(rng.uniform(0.2, 0.8))),
    )
    return _still(build)


def _debris(rng: np.random.Generator, size_m: Size) -> Body:
    build = SolidsBuilder()
    half = (0.5 * size_m[0], 0.5 * size_m[1], 0.5 * size_m[2])
    build.add(BOX, (0.0, 0.0, half[2]), half, 0.0, (PLAIN, float(rng.uniform(0.1, 0.7))))
    return _still(build)


_MAKERS: dict[str, Callable[[np.random.Generator, Size], Body]] = {
    "car": _car,
    "truck": _truck,
    "bus": _bus,
    "trailer": _trailer,
    "bicycle": _bicycle,
    "motorcycle": _motorcycle,
    "pedestrian": _pedestrian,
    "animal": _animal,
    "ball": _ball,
    "debris": _debris,
}


@dataclass(frozen=True)
class Troupe:
    """The bodies of N movers in one table."""

    solids: Solids
    """``owner`` is the mover, coordinates are in its frame."""
    swing_m: F64
    stride_m: F64
    """(P,)"""


def gather(bodies: list[Body]) -> Troupe:
    """One table of all bodies; the index in the list becomes the owner."""
    owner = np.repeat(np.arange(len(bodies)), [len(b.swing_m) for b in bodies])
    stride = np.array([b.stride_m for b in bodies])[owner]
    solids = concatenate([b.solids for b in bodies])._replace(owner=owner)
    return Troupe(solids, np.concatenate([b.swing_m for b in bodies]), stride)

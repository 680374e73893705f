"""Furniture of streets, vegetation and buildings, one function for each strip of a verge."""

from __future__ import annotations

import numpy as np

from mottrack.world.catalogue import draw_size
from mottrack.world.materials import (
    CONCRETE,
    FACADE,
    FENCE,
    FOLIAGE,
    HEDGE,
    PLAIN,
    SHOPFRONT,
    SIGN,
)
from mottrack.world.roadside import Spot, Verge
from mottrack.world.solids import BOX, CYLINDER, ELLIPSOID

_BARK = (PLAIN, 0.25)
_STEEL = (PLAIN, 0.35)


def park_row(verge: Verge, span: tuple[float, float], share: float) -> None:
    """Cars along the kerb, with gaps."""
    profile = verge.road.profile
    if profile.parking_m <= 0 or verge.network.kind == "motorway":
        return
    s = span[0] + float(verge.rng.uniform(3.0, 8.0))
    while s < span[1]:
        label = "truck" if verge.rng.random() < 0.03 else "car"
        size = draw_size(verge.rng, label)
        s += 0.5 * size[0]
        if verge.rng.random() < share and not verge.near_junction(s, 6.0):
            spot = verge.spot(s, -0.5 * profile.parking_m + float(verge.rng.normal(0.0, 0.06)))
            against = np.pi if (verge.side > 0) != (verge.rng.random() < 0.06) else 0.0
            yaw = spot.yaw_rad + against + float(verge.rng.normal(0.0, 0.02))
            verge.parked.place.append((spot.x_m, spot.y_m, yaw))
            verge.parked.label.append(label)
            verge.parked.size_m.append(size)
        s += 0.5 * size[0] + 0.6 + float(verge.rng.exponential(0.8))


def tree(verge: Verge, spot: Spot) -> None:
    """Trunk and a porous crown of one to three lobes."""
    rng, x, y, z = verge.rng, spot.x_m, spot.y_m, spot.z_m
    height, spread = float(rng.uniform(4.0, 11.0)), float(rng.uniform(1.2, 3.2))
    clear = float(rng.uniform(0.25, 0.45)) * height
    girth = float(rng.uniform(0.08, 0.3))
    verge.build.add(CYLINDER, (x, y, z + 0.4 * height), (girth, girth, 0.4 * height), 0.0, _BARK)
    for _ in range(int(rng.integers(1, 4))):
        dx, dy = rng.normal(0.0, 0.3 * spread, 2)
        tall = 0.5 * (height - clear) * float(rng.uniform(0.7, 1.0))
        centre = (x + dx, y + dy, z + height - tall)
        half = (spread * float(rng.uniform(0.6, 1.0)), spread * float(rng.uniform(0.6, 1.0)), tall)
        verge.build.add(ELLIPSOID, centre, half, 0.0, (FOLIAGE, 0.4))


def bush(verge: Verge, spot: Spot) -> None:
    """A low porous ellipsoid."""
    half = verge.rng.uniform([0.4, 0.4, 0.35], [1.4, 1.4, 0.9])
    centre = (spot.x_m, spot.y_m, spot.z_m + 0.7 * half[2])
    verge.build.add(ELLIPSOID, centre, half.tolist(), spot.yaw_rad, (HEDGE, 0.4))


def pole(verge: Verge, spot: Spot) -> None:
    """Lamp post or mast, sometimes with a sign or a signal head."""
    rng, x, y, z = verge.rng, spot.x_m, spot.y_m, spot.z_m
    height, radius = float(rng.uniform(2.4, 8.0)), float(rng.uniform(0.03, 0.12))
    verge.build.add(CYLINDER, (x, y, z + 0.5 * height), (radius, radius, 0.5 * height), 0.0, _STEEL)
    if rng.random() < 0.55:
        plate = (0.02, float(rng.uniform(0.2, 0.5)), float(rng.uniform(0.2, 0.5)))
        centre = (x, y, z + min(height - 0.4, 2.4))
        verge.build.add(
            BOX, centre, plate, spot.yaw_rad + float(rng.normal(0.0, 0.2)), (SIGN, 0.95)
        )


def clutter(verge: Verge, spot: Spot) -> None:
    """Bins, boxes, benches, bollards, hydrants, parked scooters."""
    rng = verge.rng
    kind = int(rng.integers(0, 3))
    half = rng.uniform([0.1, 0.1, 0.25], [0.7, 0.4, 0.75])
    centre = (spot.x_m, spot.y_m, spot.z_m + half[2])
    yaw = spot.yaw_rad + float(rng.normal(0.0, 0.15))
    if kind == 0:
        half[1] = half[0] = 0.5 * half[0] + 0.05
        verge.build.add(CYLINDER, centre, half.tolist(), yaw, (PLAIN, 0.3))
    elif kind == 1:
        verge.build.add(BOX, centre, half.tolist(), yaw, (PLAIN, float(rng.uniform(0.1, 0.6))))
    else:
        verge.build.add(BOX, centre, (0.6, 0.08, 0.4), yaw, (FENCE, 0.3))


def furniture_strip(verge: Verge, span: tuple[float, float]) -> None:
    """Poles, trees and clutter in the first metre behind the kerb."""
    rng = verge.rng
    leafy = float(rng.choice([0.0, 0.3, 0.6]))
    narrow = verge.road.profile.pavement_m < 2.0
    s = span[0]
    while s < span[1]:
        s += 1.5 + float(rng.exponential(4.0))
        spot = verge.spot(s, 0.25 if narrow else float(rng.uniform(0.35, 0.8)))
        if verge.on_road(spot, 0.15):
            continue
        u = rng.random()
        if u < leafy:
            tree(verge, spot)
        elif u < leafy + 0.2:
            pole(verge, spot)
        elif u < leafy + 0.4:
            clutter(verge, spot)


def doorsteps(verge: Verge, span: tuple[float, float], back_m: float) -> None:
    """What leans and stands at the line of the houses: steps, planters, bins, cycles, bushes."""
    rng = verge.rng
    s = span[0]
    while s < span[1]:
        s += float(rng.exponential(5.0))
        spot = verge.spot(s, back_m - float(rng.uniform(0.0, 0.3)))
        if not verge.on_road(spot, 0.5):
            (bush if rng.random() < 0.25 else clutter)(verge, spot)


def back_land(verge: Verge, span: tuple[float, float], back_m: float) -> None:
    """Trees, bushes and sheds further away, seen through the gaps."""
    rng = verge.rng
    s = span[0]
    while s < span[1]:
        s += float(rng.exponential(9.0))
        spot = verge.spot(s, back_m + float(rng.uniform(6.0, 30.0)))
        if verge.on_road(spot, 3.0):
            continue
        u = rng.random()
        if u < 0.8:
            (tree if u < 0.5 else bush)(verge, spot)
        else:
            verge.wall((s - 3.0, s + 3.0), back_m + 14.0, (4.0, 2.6), (PLAIN, 0.5))


def building_line(verge: Verge, span: tuple[float, float], back_m: float) -> None:
    """Facades with set-backs, canopies, and gaps between houses."""
    rng = verge.rng
    s = span[0]
    while s < span[1]:
        width = float(rng.uniform(7.0, 28.0))
        if rng.random() < 0.85:
            setback = back_m + float(rng.choice([0.0, 0.0, rng.uniform(0.0, 3.0)]))
            _house(verge, (s, s + width), setback)
        elif width > 10.0 and rng.random() < 0.4:
            car_park(verge, (s, s + width), back_m)
        s += width + float(rng.choice([0.0, 0.0, rng.uniform(1.0, 9.0)]))


def _house(verge: Verge, ends: tuple[float, float], back_m: float) -> None:
    rng = verge.rng
    height, albedo = float(rng.uniform(4.0, 18.0)), float(rng.uniform(0.25, 0.75))
    skin = SHOPFRONT if rng.random() < 0.25 else FACADE
    if not verge.wall(ends, back_m, (9.0, height), (skin, albedo)):
        return
    width = ends[1] - ends[0]
    for _ in range(int(rng.integers(0, 4))):
        at = ends[0] + float(rng.uniform(0.1, 0.9)) * width
        out = float(rng.uniform(0.15, 0.7))
        verge.wall(
            (at, at + float(rng.uniform(0.4, 2.5))),
            back_m - out,
            (out + 0.1, height * 0.8),
            (PLAIN, albedo),
        )
    if rng.random() < 0.3:
        _canopy(verge, ends, back_m)


def _canopy(verge: Verge, ends: tuple[float, float], back_m: float) -> None:
    """A roof over the pavement at first-floor height."""
    spot = verge.spot(0.5 * (ends[0] + ends[1]), back_m - 0.5)
    half = (0.4 * (ends[1] - ends[0]), float(verge.rng.uniform(0.4, 0.9)), 0.08)
    centre = (spot.x_m, spot.y_m, spot.z_m + float(verge.rng.uniform(2.3, 3.2)))
    verge.build.add(BOX, centre, half, spot.yaw_rad, (PLAIN, 0.4))


def garden_line(verge: Verge, span: tuple[float, float], back_m: float) -> None:
    """Hedges, fences, low walls, bushes and trees, and houses further back."""
    rng = verge.rng
    s = span[0]
    while s < span[1]:
        width = float(rng.uniform(5.0, 18.0))
        ends, u = (s, s + width), rng.random()
        if u < 0.3:
            verge.wall(
                ends,
                back_m,
                (float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.9, 2.2))),
                (HEDGE, 0.4),
            )
        elif u < 0.55:
            verge.wall(ends, back_m, (0.06, float(rng.uniform(0.9, 1.8))), (FENCE, 0.3))
        elif u < 0.68:
            verge.wall(ends, back_m, (0.25, float(rng.uniform(0.5, 1.4))), (CONCRETE, 0.45))
        elif u < 0.8:
            car_park(verge, ends, back_m)
            s += width
            continue
        _garden(verge, ends, back_m)
        if rng.random() < 0.6:
            _house(verge, (s + 1.0, s + width - 1.0), back_m + float(rng.uniform(4.0, 12.0)))
        s += width + float(rng.choice([0.0, rng.uniform(2.0, 4.0)]))


def _garden(verge: Verge, ends: tuple[float, float], back_m: float) -> None:
    for _ in range(int(verge.rng.integers(0, 4))):
        spot = verge.spot(
            float(verge.rng.uniform(*ends)), back_m + float(verge.rng.uniform(1.0, 8.0))
        )
        if not verge.on_road(spot, 1.2):
            (tree if verge.rng.random() < 0.45 else bush)(verge, spot)


def guard_rail(verge: Verge, span: tuple[float, float], beyond_m: float) -> None:
    """A rail at 0.5 to 0.8 m on posts."""
    s = span[0]
    while s < span[1] - 1.0:
        end = min(s + 8.0, span[1])
        a, b = verge.spot(s, beyond_m), verge.spot(end, beyond_m)
        middle = ((a.x_m + b.x_m) / 2, (a.y_m + b.y_m) / 2, (a.z_m + b.z_m) / 2 + 0.62)
        yaw = float(np.arctan2(b.y_m - a.y_m, b.x_m - a.x_m))
        half = (0.5 * float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m)), 0.05, 0.16)
        verge.build.add(BOX, middle, half, yaw, _STEEL)
        for at in (s, s + 4.0):
            spot = verge.spot(at, beyond_m + 0.1)
            verge.build.add(
                BOX, (spot.x_m, spot.y_m, spot.z_m + 0.35), (0.05, 0.05, 0.35), yaw, _STEEL
            )
        s = end


def median(verge: Verge, span: tuple[float, float]) -> None:
    """What divides the directions: a rail or a concrete barrier, or hedges and poles."""
    width, rng = verge.road.profile.median_m, verge.rng
    if width < 1.0:
        return
    inward = -verge.road.profile.half_carriageway_m
    motorway = verge.network.kind == "motorway"
    style = str(rng.choice(["rail", "wall", "green"] if motorway else ["green", "rail", "bare"]))
    s = span[0]
    while s < span[1] - 4.0:
        spot, length = verge.spot(s + 4.0, inward), 4.0
        if not verge.near_junction(s + 4.0, 5.0):
            if style == "wall":
                middle = (spot.x_m, spot.y_m, spot.z_m + 0.4)
                verge.build.add(BOX, middle, (length, 0.15, 0.5), spot.yaw_rad, (CONCRETE, 0.45))
            elif style == "rail":
                guard_rail(verge, (s, s + 8.0), inward)
            elif style == "green" and rng.random() < 0.6:
                (pole if rng.random() < 0.3 else bush)(verge, spot)
        s += 8.0


def bridge(verge: Verge, span: tuple[float, float]) -> None:
    """A deck across the road on piers."""
    s = float(verge.rng.uniform(*span))
    if verge.near_junction(s, 12.0):
        return
    half = verge.road.profile.half_m + 6.0
    spot = verge.spot(s, -verge.road.profile.half_carriageway_m)
    clear = float(verge.rng.uniform(4.7, 6.5))
    deck = (float(verge.rng.uniform(2.0, 7.0)), half, 0.6)
    verge.build.add(
        BOX, (spot.x_m, spot.y_m, spot.z_m + clear + 0.6), deck, spot.yaw_rad, (CONCRETE, 0.4)
    )
    for beyond in (1.0, -2.0 * verge.road.profile.half_carriageway_m - 1.0):
        pier = verge.spot(s, beyond)
        middle = (pier.x_m, pier.y_m, pier.z_m + 0.5 * clear)
        verge.build.add(BOX, middle, (deck[0], 0.4, 0.5 * clear), pier.yaw_rad, (CONCRETE, 0.4))


def car_park(verge: Verge, ends: tuple[float, float], back_m: float) -> None:
    """A row of cars that stand across, behind the pavement."""
    rng, s = verge.rng, ends[0] + 1.5
    while s < ends[1] - 1.5:
        size, spot = draw_size(rng, "car"), verge.spot(s, back_m + 3.2)
        if rng.random() < 0.75 and not verge.on_road(spot, 3.0):
            yaw = spot.yaw_rad + np.pi / 2 * float(rng.choice([-1.0, 1.0]))
            verge.parked.place.append((spot.x_m, spot.y_m, yaw + float(rng.normal(0.0, 0.03))))
            verge.parked.label.append("car")
            verge.parked.size_m.append(size)
        s += 2.7


def motorway_verge(verge: Verge, span: tuple[float, float]) -> None:
    """Guard rail, then noise barrier, trees and bushes, or open land; gantries now and then."""
    rng = verge.rng
    if rng.random() < 0.85:
        guard_rail(verge, span, float(rng.uniform(0.5, 1.5)))
    style = str(rng.choice(["barrier", "trees", "open", "mixed"]))
    s = span[0]
    while s < span[1]:
        width = float(rng.uniform(10.0, 40.0))
        if style == "barrier" or (style == "mixed" and rng.random() < 0.4):
            verge.wall((s, s + width), 4.0, (0.25, float(rng.uniform(2.5, 4.5))), (CONCRETE, 0.4))
        for _ in range(int(rng.integers(0, 5)) if style in ("trees", "mixed") else 0):
            spot = verge.spot(s + float(rng.uniform(0.0, width)), float(rng.uniform(6.0, 25.0)))
            (tree if rng.random() < 0.6 else bush)(verge, spot)
        if rng.random() < 0.5:
            pole(verge, verge.spot(s, float(rng.uniform(2.0, 3.0))))
        s += width

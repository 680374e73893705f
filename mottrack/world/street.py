"""Street furniture, vegetation, buildings and barriers along a side of a road.

Heights, distances and shares are chosen by eye, so that streets look like those of recorded
scenes: what matters for a tracker is how much is occluded and what looks like a vehicle.
"""

from __future__ import annotations

import numpy as np

from mottrack.world.catalogue import draw_size
from mottrack.world.curves import Interval
from mottrack.world.materials import (
    CONCRETE,
    FACADE,
    FENCE,
    FOLIAGE,
    HEDGE,
    PLAIN,
    SHOPFRONT,
    SIGN,
    Surface,
)
from mottrack.world.roadside import RoadsideStrip, Spot
from mottrack.world.solids import CYLINDER, ELLIPSOID

_BARK, _STEEL = Surface(PLAIN, 0.25), Surface(PLAIN, 0.35)
_LEAVES, _HEDGE, _FENCE = Surface(FOLIAGE, 0.4), Surface(HEDGE, 0.4), Surface(FENCE, 0.3)
_CANOPY, _BIN, _SHED = Surface(PLAIN, 0.4), Surface(PLAIN, 0.3), Surface(PLAIN, 0.5)
_DECK, _GARDEN_WALL = Surface(CONCRETE, 0.4), Surface(CONCRETE, 0.45)
_SIGN = Surface(SIGN, 0.95)  # Retroreflecting


def line_road(strip: RoadsideStrip, parked: float) -> None:
    """Add everything along one side of a road, within the terrain.

    Args:
        strip: the side of the road.
        parked: factor on the number of vehicles at the kerb.
    """
    rng, motorway = strip.rng, strip.network.kind == "motorway"
    span = strip.on_terrain()
    if span.length_m < 10.0:
        return
    if strip.side == 1:  # once a road
        _median(strip, span)
        if rng.random() < (0.4 if motorway else 0.08):
            _bridge(strip, span)
    if motorway:
        _motorway_side(strip, span)
        return
    _park_row(strip, span, float(rng.choice([0.0, 0.4, 0.7, 0.92])) * parked)
    _furniture(strip, span)
    back = strip.road.profile.pavement_m
    built_up = rng.random() < (0.7 if strip.network.kind == "urban" else 0.15)
    (_building_line if built_up else _garden_line)(strip, span, back)
    _doorsteps(strip, span, back)
    _back_land(strip, span, back)


def _park_row(strip: RoadsideStrip, span: Interval, share: float) -> None:
    """Add cars along the kerb, with gaps."""
    rng, parking = strip.rng, strip.road.profile.parking_m
    if parking <= 0:
        return
    s = span.start_m + float(rng.uniform(3.0, 8.0))
    while s < span.end_m:
        label = "truck" if rng.random() < 0.03 else "car"
        size = draw_size(rng, label)
        s += 0.5 * size.length
        if rng.random() < share and not strip.near_junction(s, 6.0):
            spot = strip.spot(s, -0.5 * parking + float(rng.normal(0.0, 0.06)))
            # few park against the direction of driving
            against = np.pi if (strip.side > 0) != (rng.random() < 0.06) else 0.0
            strip.park(spot, spot.yaw_rad + against + float(rng.normal(0.0, 0.02)), label, size)
        s += 0.5 * size.length + 0.6 + float(rng.exponential(0.8))


def _car_park(strip: RoadsideStrip, ends: Interval, back_m: float) -> None:
    """Add a row of cars that stand across, behind the pavement."""
    rng, s = strip.rng, ends.start_m + 1.5
    while s < ends.end_m - 1.5:
        size, spot = draw_size(rng, "car"), strip.spot(s, back_m + 3.2)
        if rng.random() < 0.75 and not strip.on_road(spot, 3.0):
            yaw = spot.yaw_rad + np.pi / 2 * float(rng.choice([-1.0, 1.0]))
            strip.park(spot, yaw + float(rng.normal(0.0, 0.03)), "car", size)
        s += 2.7


def _tree(strip: RoadsideStrip, spot: Spot) -> None:
    """Add a trunk and a porous crown of one to three lobes."""
    rng, x, y, z = strip.rng, spot.x_m, spot.y_m, spot.z_m
    height, spread = float(rng.uniform(4.0, 11.0)), float(rng.uniform(1.2, 3.2))
    clear = float(rng.uniform(0.25, 0.45)) * height
    girth = float(rng.uniform(0.08, 0.3))
    strip.build.add(CYLINDER, (x, y, z + 0.4 * height), (girth, girth, 0.4 * height), _BARK)
    for _ in range(int(rng.integers(1, 4))):
        dx, dy = rng.normal(0.0, 0.3 * spread, 2)
        tall = 0.5 * (height - clear) * float(rng.uniform(0.7, 1.0))
        centre = (x + dx, y + dy, z + height - tall)
        half = (spread * float(rng.uniform(0.6, 1.0)), spread * float(rng.uniform(0.6, 1.0)), tall)
        strip.build.add(ELLIPSOID, centre, half, _LEAVES)


def _bush(strip: RoadsideStrip, spot: Spot) -> None:
    half = strip.rng.uniform([0.4, 0.4, 0.35], [1.4, 1.4, 0.9])
    strip.build.add(ELLIPSOID, spot.above(0.7 * half[2]), half.tolist(), _HEDGE, spot.yaw_rad)


def _pole(strip: RoadsideStrip, spot: Spot) -> None:
    """Add a lamp post or mast, sometimes with a sign or a signal head."""
    rng = strip.rng
    height, radius = float(rng.uniform(2.4, 8.0)), float(rng.uniform(0.03, 0.12))
    half = (radius, radius, 0.5 * height)
    strip.build.add(CYLINDER, spot.above(0.5 * height), half, _STEEL)
    if rng.random() < 0.55:
        plate = (0.02, float(rng.uniform(0.2, 0.5)), float(rng.uniform(0.2, 0.5)))
        yaw = spot.yaw_rad + float(rng.normal(0.0, 0.2))
        strip.build.add_box(spot.above(min(height - 0.4, 2.4)), plate, _SIGN, yaw)


def _clutter(strip: RoadsideStrip, spot: Spot) -> None:
    """Add a bin or bollard, a box or bench, or a parked scooter."""
    rng = strip.rng
    kind = int(rng.integers(0, 3))
    half = rng.uniform([0.1, 0.1, 0.25], [0.7, 0.4, 0.75])
    centre = spot.above(half[2])
    yaw = spot.yaw_rad + float(rng.normal(0.0, 0.15))
    if kind == 0:
        half[1] = half[0] = 0.5 * half[0] + 0.05
        strip.build.add(CYLINDER, centre, half.tolist(), _BIN, yaw)
    elif kind == 1:
        surface = Surface(PLAIN, float(rng.uniform(0.1, 0.6)))
        strip.build.add_box(centre, half.tolist(), surface, yaw)
    else:
        strip.build.add_box(centre, (0.6, 0.08, 0.4), _FENCE, yaw)


def _furniture(strip: RoadsideStrip, span: Interval) -> None:
    """Add poles, trees and clutter in the first metre behind the kerb."""
    rng = strip.rng
    leafy = float(rng.choice([0.0, 0.3, 0.6]))
    narrow = strip.road.profile.pavement_m < 2.0
    s = span.start_m
    while s < span.end_m:
        s += 1.5 + float(rng.exponential(4.0))
        spot = strip.spot(s, 0.25 if narrow else float(rng.uniform(0.35, 0.8)))
        if strip.on_road(spot, 0.15):
            continue
        u = rng.random()
        if u < leafy:
            _tree(strip, spot)
        elif u < leafy + 0.2:
            _pole(strip, spot)
        elif u < leafy + 0.4:
            _clutter(strip, spot)


def _doorsteps(strip: RoadsideStrip, span: Interval, back_m: float) -> None:
    """Add what leans and stands at the houses: steps, planters, bins, cycles, bushes."""
    rng, s = strip.rng, span.start_m
    while s < span.end_m:
        s += float(rng.exponential(5.0))
        spot = strip.spot(s, back_m - float(rng.uniform(0.0, 0.3)))
        if not strip.on_road(spot, 0.5):
            (_bush if rng.random() < 0.25 else _clutter)(strip, spot)


def _back_land(strip: RoadsideStrip, span: Interval, back_m: float) -> None:
    """Add trees, bushes and sheds further away, seen through the gaps."""
    rng, s = strip.rng, span.start_m
    while s < span.end_m:
        s += float(rng.exponential(9.0))
        spot = strip.spot(s, back_m + float(rng.uniform(6.0, 30.0)))
        if strip.on_road(spot, 3.0):
            continue
        u = rng.random()
        if u < 0.8:
            (_tree if u < 0.5 else _bush)(strip, spot)
        else:
            strip.wall(Interval(s - 3.0, s + 3.0), back_m + 14.0, 4.0, 2.6, _SHED)


def _building_line(strip: RoadsideStrip, span: Interval, back_m: float) -> None:
    """Add facades with set-backs, canopies, and gaps between houses."""
    rng, s = strip.rng, span.start_m
    while s < span.end_m:
        width = float(rng.uniform(7.0, 28.0))
        if rng.random() < 0.85:
            setback = back_m + float(rng.choice([0.0, 0.0, rng.uniform(0.0, 3.0)]))
            _house(strip, Interval(s, s + width), setback)
        elif width > 10.0 and rng.random() < 0.4:
            _car_park(strip, Interval(s, s + width), back_m)
        s += width + float(rng.choice([0.0, 0.0, rng.uniform(1.0, 9.0)]))


def _house(strip: RoadsideStrip, ends: Interval, back_m: float) -> None:
    """Add a facade with up to three projections and perhaps a canopy over the pavement."""
    rng = strip.rng
    height, albedo = float(rng.uniform(4.0, 18.0)), float(rng.uniform(0.25, 0.75))
    skin = SHOPFRONT if rng.random() < 0.25 else FACADE
    if not strip.wall(ends, back_m, 9.0, height, Surface(skin, albedo)):
        return
    for _ in range(int(rng.integers(0, 4))):
        start = ends.start_m + float(rng.uniform(0.1, 0.9)) * ends.length_m
        out = float(rng.uniform(0.15, 0.7))
        part = Interval(start, start + float(rng.uniform(0.4, 2.5)))
        strip.wall(part, back_m - out, out + 0.1, height * 0.8, Surface(PLAIN, albedo))
    if rng.random() < 0.3:
        spot = strip.spot(0.5 * (ends.start_m + ends.end_m), back_m - 0.5)
        half = (0.4 * ends.length_m, float(rng.uniform(0.4, 0.9)), 0.08)
        above = spot.above(float(rng.uniform(2.3, 3.2)))  # at first-floor height
        strip.build.add_box(above, half, _CANOPY, spot.yaw_rad)


def _garden_line(strip: RoadsideStrip, span: Interval, back_m: float) -> None:
    """Add hedges, fences, low walls, bushes and trees, and houses further back."""
    rng, s = strip.rng, span.start_m
    while s < span.end_m:
        width = float(rng.uniform(5.0, 18.0))
        ends, u = Interval(s, s + width), rng.random()
        if 0.68 <= u < 0.8:
            _car_park(strip, ends, back_m)
            s += width
            continue
        _garden(strip, ends, back_m, u)
        if rng.random() < 0.6:
            house = Interval(s + 1.0, s + width - 1.0)
            _house(strip, house, back_m + float(rng.uniform(4.0, 12.0)))
        s += width + float(rng.choice([0.0, rng.uniform(2.0, 4.0)]))


def _garden(strip: RoadsideStrip, ends: Interval, back_m: float, u: float) -> None:
    """Add a garden behind a hedge, a fence, a low wall or, above u = 0.68, nothing."""
    rng = strip.rng
    if u < 0.3:
        thickness, height = float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.9, 2.2))
        strip.wall(ends, back_m, thickness, height, _HEDGE)
    elif u < 0.55:
        strip.wall(ends, back_m, 0.06, float(rng.uniform(0.9, 1.8)), _FENCE)
    elif u < 0.68:
        strip.wall(ends, back_m, 0.25, float(rng.uniform(0.5, 1.4)), _GARDEN_WALL)
    for _ in range(int(rng.integers(0, 4))):
        spot = strip.spot(float(rng.uniform(*ends)), back_m + float(rng.uniform(1.0, 8.0)))
        if not strip.on_road(spot, 1.2):
            (_tree if rng.random() < 0.45 else _bush)(strip, spot)


def _guard_rail(strip: RoadsideStrip, span: Interval, beyond_m: float) -> None:
    """Add a rail at 0.46 to 0.78 m on posts every 4 m, as of the European W profile."""
    s = span.start_m
    while s < span.end_m - 1.0:
        end = min(s + 8.0, span.end_m)
        a, b = strip.spot(s, beyond_m), strip.spot(end, beyond_m)
        middle = ((a.x_m + b.x_m) / 2, (a.y_m + b.y_m) / 2, (a.z_m + b.z_m) / 2 + 0.62)
        yaw = float(np.arctan2(b.y_m - a.y_m, b.x_m - a.x_m))
        half = (0.5 * float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m)), 0.05, 0.16)
        strip.build.add_box(middle, half, _STEEL, yaw)
        for post in (s, s + 4.0):
            above = strip.spot(post, beyond_m + 0.1).above(0.35)
            strip.build.add_box(above, (0.05, 0.05, 0.35), _STEEL, yaw)
        s = end


def _median(strip: RoadsideStrip, span: Interval) -> None:
    """Add what divides the directions: a rail or a concrete barrier, or hedges and poles."""
    rng, s = strip.rng, span.start_m
    if strip.road.profile.median_m < 1.0:
        return
    inward = -strip.road.profile.half_carriageway_m
    motorway = strip.network.kind == "motorway"
    style = str(rng.choice(["rail", "wall", "green"] if motorway else ["green", "rail", "bare"]))
    while s < span.end_m - 4.0:
        spot = strip.spot(s + 4.0, inward)
        if not strip.near_junction(s + 4.0, 5.0):
            if style == "wall":
                strip.build.add_box(spot.above(0.4), (4.0, 0.15, 0.5), _GARDEN_WALL, spot.yaw_rad)
            elif style == "rail":
                _guard_rail(strip, Interval(s, s + 8.0), inward)
            elif style == "green" and rng.random() < 0.6:
                (_pole if rng.random() < 0.3 else _bush)(strip, spot)
        s += 8.0


def _bridge(strip: RoadsideStrip, span: Interval) -> None:
    """Add a deck across the road on piers, with the usual clearance of 4.7 m or more."""
    s = float(strip.rng.uniform(*span))
    if strip.near_junction(s, 12.0):
        return
    half_carriageway = strip.road.profile.half_carriageway_m
    spot = strip.spot(s, -half_carriageway)
    clear = float(strip.rng.uniform(4.7, 6.5))
    width = float(strip.rng.uniform(2.0, 7.0))
    deck = (width, strip.road.profile.half_m + 6.0, 0.6)
    centre = (spot.x_m, spot.y_m, spot.z_m + clear + 0.6)
    strip.build.add_box(centre, deck, _DECK, spot.yaw_rad)
    for beyond in (1.0, -2.0 * half_carriageway - 1.0):
        pier = strip.spot(s, beyond)
        half = (width, 0.4, 0.5 * clear)
        strip.build.add_box(pier.above(0.5 * clear), half, _DECK, pier.yaw_rad)


def _motorway_side(strip: RoadsideStrip, span: Interval) -> None:
    """Add a guard rail, then noise barrier, trees and bushes, or open land; masts at times."""
    rng, s = strip.rng, span.start_m
    if rng.random() < 0.85:
        _guard_rail(strip, span, float(rng.uniform(0.5, 1.5)))
    style = str(rng.choice(["barrier", "trees", "open", "mixed"]))
    while s < span.end_m:
        width = float(rng.uniform(10.0, 40.0))
        if style == "barrier" or (style == "mixed" and rng.random() < 0.4):
            strip.wall(Interval(s, s + width), 4.0, 0.25, float(rng.uniform(2.5, 4.5)), _DECK)
        for _ in range(int(rng.integers(0, 5)) if style in ("trees", "mixed") else 0):
            spot = strip.spot(s + float(rng.uniform(0.0, width)), float(rng.uniform(6.0, 25.0)))
            (_tree if rng.random() < 0.6 else _bush)(strip, spot)
        if rng.random() < 0.5:
            _pole(strip, strip.spot(s, float(rng.uniform(2.0, 3.0))))
        s += width

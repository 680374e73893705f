"""Sensor models: where the beams of a spinning LiDAR point and how well it sees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import unknown_name


@dataclass(frozen=True)
class SensorModel:
    """A spinning LiDAR.

    The models below follow the kinds of sensors on the market (uniform fan, denser towards the
    horizon, two blocks), not any maker's calibration file. Ranges, noise and columns are of the
    order of their data sheets: 100 to 200 m, 1 to 2 cm, 0.18 to 0.35 degrees.
    """

    name: str
    elevation_rad: F64
    """(R,) elevations, lowest first."""
    offset_rad: F64
    """(R,) azimuth of each beam relative to its column."""
    columns: int
    """Firings in one revolution."""
    max_range_m: float
    """Range beyond which nothing is reported."""
    reach_m: float
    """Range at which a white wall (albedo 0.8) facing the sensor is seen two times out of three."""
    range_noise_m: float
    drop_out: float
    """Share of returns lost at random."""
    height_m: float = 1.84
    """As on nuScenes' cars."""
    forward_m: float = 0.9
    """Mounting point ahead of the vehicle's rear axle; nuScenes: 0.94."""
    clockwise: bool = True
    start_rad: float = np.pi
    """Azimuth of the first column."""


def _fan(rings: int, low_deg: float, high_deg: float, focus: float = 0.0) -> F64:
    """Return elevations from low to high; ``focus`` > 0 crowds them around the horizon."""
    u = np.linspace(0.0, 1.0, rings)
    # slightly below the horizon, where the ground far away is
    horizon = -low_deg / (high_deg - low_deg) * 0.9
    skew = u + focus * np.sin(2.0 * np.pi * (u - horizon)) / (2.0 * np.pi)
    skew = (skew - skew[0]) / (skew[-1] - skew[0])
    return np.deg2rad(low_deg + (high_deg - low_deg) * np.sort(skew))


def _ramp(low_deg: float, high_deg: float, rings: int) -> F64:
    return np.deg2rad(np.linspace(low_deg, high_deg, rings))


def _stagger(rings: int, span_deg: float, period: int = 4) -> F64:
    """Return azimuth offsets of beams that do not fire in one vertical plane."""
    place = (np.arange(rings) % period) / max(period - 1, 1) - 0.5
    return place * float(np.deg2rad(span_deg))


def _catalogue() -> dict[str, SensorModel]:
    uniform32 = _fan(32, -30.67, 10.67)
    # 32 beams in thirds of a degree above 32 in halves, as on 64-beam roof sensors of 2007
    blocks64 = np.concatenate([_ramp(-24.33, -8.83, 32), _ramp(-8.33, 2.0, 32)])
    outer = np.deg2rad([-25.0, -15.6, -11.3, -8.8, -7.2, -6.1, 7.0, 10.3, 15.0])
    uneven32 = np.sort(np.concatenate([outer, _ramp(-5.2, 4.6, 23)]))
    upper = np.deg2rad([3.0, 5.0, 7.5, 10.0, 12.5, 15.0])
    uneven64 = np.concatenate([_ramp(-25.0, -6.2, 12), _ramp(-5.9, 2.0, 46), upper])
    # two sensors of 32 beams on top of each other, as on Argoverse's cars
    stacked64 = np.sort(np.concatenate([uneven32, uneven32 + np.deg2rad(0.11)]))
    uniform64, uniform128 = _fan(64, -22.5, 22.5), _fan(128, -22.5, 22.5)
    uneven128 = _fan(128, -25.0, 15.0, 0.8)
    # name, elevations, offsets, columns, max range, reach, range noise, drop-out
    models = (
        SensorModel("uniform32", uniform32, np.zeros(32), 1085, 100.0, 105.0, 0.02, 0.05),
        SensorModel("uneven32", uneven32, _stagger(32, 2.8), 1800, 120.0, 140.0, 0.02, 0.04),
        SensorModel("blocks64", blocks64, np.zeros(64), 2000, 120.0, 135.0, 0.015, 0.06),
        SensorModel("uneven64", uneven64, _stagger(64, 4.2), 1800, 150.0, 170.0, 0.015, 0.04),
        SensorModel("stacked64", stacked64, _stagger(64, 2.8, 2), 1800, 150.0, 140.0, 0.015, 0.04),
        SensorModel("uniform64", uniform64, np.zeros(64), 1024, 120.0, 110.0, 0.015, 0.05),
        SensorModel("uniform128", uniform128, np.zeros(128), 1024, 150.0, 120.0, 0.015, 0.05),
        SensorModel("uneven128", uneven128, _stagger(128, 5.0), 1800, 200.0, 190.0, 0.012, 0.03),
    )
    return {model.name: model for model in models}


SENSORS: dict[str, SensorModel] = _catalogue()


def sensor_model(name: str) -> SensorModel:
    """Return the model of that name.

    Raises:
        ConfigError: no model has that name.
    """
    if name not in SENSORS:
        raise unknown_name("LiDAR model", name, [*SENSORS, "random"])
    return SENSORS[name]


def random_sensor(rng: np.random.Generator) -> SensorModel:
    """Draw a sensor that no maker builds but that resembles those that they build.

    Shares and bounds are chosen by eye, so that the sensors of the public data sets (32 to 128
    beams, 5 to 30 mm of noise, 1.6 to 2.1 m above the ground) lie well inside.
    """
    base = SENSORS[str(rng.choice(sorted(SENSORS)))]
    if rng.random() < 0.4:
        base = _invented(rng)
    elevation = base.elevation_rad + np.deg2rad(rng.uniform(-1.5, 1.5))
    elevation = elevation + np.deg2rad(rng.normal(0.0, 0.03, len(elevation)))
    return replace(
        base,
        name=f"random-{base.name}",
        elevation_rad=np.sort(elevation),
        columns=int(rng.integers(900, 2001)),
        range_noise_m=float(rng.uniform(0.005, 0.03)),
        drop_out=float(rng.uniform(0.0, 0.15)),
        reach_m=float(base.reach_m * rng.uniform(0.7, 1.2)),
        height_m=float(rng.uniform(1.6, 2.1)),
        forward_m=float(rng.uniform(0.0, 1.5)),
        clockwise=bool(rng.random() < 0.7),
        start_rad=float(rng.uniform(-np.pi, np.pi)),
    )


def _invented(rng: np.random.Generator) -> SensorModel:
    rings = int(rng.choice([32, 40, 48, 64, 80, 96, 128]))
    low, high = rng.uniform(-32.0, -15.0), rng.uniform(2.0, 20.0)
    focus = rng.uniform(0.0, 0.85) if rng.random() < 0.6 else 0.0
    elevation = _fan(rings, float(low), float(high), float(focus))
    offset = _stagger(rings, float(rng.uniform(0.0, 6.0)), int(rng.choice([1, 2, 4, 8])))
    reach = float(rng.uniform(90, 180))
    return SensorModel("invented", elevation, offset, 1200, 120.0, reach, 0.02, 0.05)

"""Agents that follow the routes of a network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mottrack.core.arrays import F64, I64, Texts
from mottrack.world.curves import Paths
from mottrack.world.roads import Route


class Sway(NamedTuple):
    """Lateral oscillation of an agent about its path: a sine over the arc length."""

    amplitude_m: float
    wave_m: float
    phase_rad: float


class Agents(NamedTuple):
    """N agents that follow routes, arrays (N,); row 0 is the ego vehicle; named tuple for numba."""

    path: I64
    """Route that it follows."""
    size_m: F64
    """(N, 3)"""
    desired_mps: F64
    lateral_m: F64
    """To the left of the route."""
    sway_amplitude_m: F64
    sway_wave_m: F64
    sway_phase_rad: F64
    acceleration_mps2: F64
    """This and the next three: the ``Driver``."""
    braking_mps2: F64
    gap_m: F64
    headway_s: F64
    wheelbase_m: F64
    stop_m: F64
    """Stop line of the route."""
    approach: I64
    """Signal that holds there."""
    towed_by: I64
    """The agent that pulls it, -1 for all but trailers."""


@dataclass(frozen=True)
class Traffic:
    """Agents on routes at time 0."""

    label: Texts
    agents: Agents
    start_m: F64
    """(N,) arc length of the reference point."""
    speed_mps: F64
    paths: Paths
    routes: tuple[Route, ...]

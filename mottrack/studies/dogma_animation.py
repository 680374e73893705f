"""Animate the dynamic occupancy grid map (DOGMa) of a scene, sweep by sweep."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import FlowSource, Scene
from mottrack.core.sweep import Sweep, median_period_s, seconds_between
from mottrack.experiment.experiment import Experiment
from mottrack.flow.dogma.source import DogmaFlow
from mottrack.viz.dogma import MapPicture


def map_pictures(experiment: Experiment, scene: Scene) -> Iterator[MapPicture]:
    """Yield a picture of the map after every sweep but the first.

    Raises:
        ConfigError: the experiment's flow source keeps no map, or the scene has no sweeps.
        InputError: time or the vehicle jumps.
    """
    source: FlowSource = experiment.flow.make(grid=experiment.settings.grid.grid())
    if not isinstance(source, DogmaFlow):
        raise ConfigError(f"flow '{experiment.flow.kind}' keeps no map; choose flow=dogma")
    if not scene.has_sweeps:
        raise ConfigError(f"scene '{scene.name}' has no sweeps, from which the map is made")
    source.reset()
    sweeps = (scene.sweep(index) for index in range(len(scene)))
    start_ns = scene.frame(0).stamp_ns
    for previous, current in pairwise(sweeps):
        source.estimate([previous], current)
        yield _picture(source, current, seconds_between(start_ns, current.stamp_ns))


def sweep_period_s(scene: Scene) -> float:
    """Return the median time between the sweeps of a scene; 1 s for a scene of one sweep."""
    stamps_ns = [scene.frame(index).stamp_ns for index in range(len(scene))]
    return median_period_s(stamps_ns, default_s=1.0)


def _picture(source: DogmaFlow, sweep: Sweep, time_s: float) -> MapPicture:
    grid_map, moving = source.current_map()
    x_m, y_m = grid_map.window.corner_m
    return MapPicture(
        occupied=grid_map.masses.occupied,
        free=grid_map.masses.free,
        moving=moving,
        velocity_mps=grid_map.moments.velocity_mps,
        corner_m=(float(x_m), float(y_m)),
        cell_m=grid_map.window.cell_m,
        world_T_ego=sweep.world_T_ego,
        title=f"{time_s:.1f} s",
    )

"""The paper's ball: what no detector knows, from above and its speed over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mottrack.core.arrays import F64
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import TruthTable
from mottrack.paper.stray import Sighting, best_tracked, clustered, tracked

TRUTH_COLOUR, POINT_COLOUR, VEHICLE_COLOUR = "#111827", "#94a3b8", "#64748b"
COLOURS = ("#2563eb", "#c2410c", "#7c3aed")
MARGIN_M = 4.0
ARROW_S = 0.5
"""An arrow is the way of so many seconds."""
ARROW_EVERY, SWEEP_EVERY = 5, 8
LEGEND: dict[str, Any] = {
    "fontsize": 8,
    "loc": "upper center",
    "bbox_to_anchor": (0.5, -0.16),
    "ncols": 2,
}

Run = tuple[SceneResult, list[Snapshot]]


@dataclass(frozen=True)
class _Line:
    """What one run saw of the mover, and how it is drawn."""

    title: str
    colour: str
    tracks: Sighting
    clusters: Sighting


def draw_ball(runs: Mapping[str, Run]) -> tuple[Figure, str] | None:
    """Its way from above and its speed over time: true, measured by the flow, and tracked.

    Args:
        runs: title to the result and the snapshots of one scene, which differ in the flow.

    Returns:
        The figure and two sentences on what it shows; None where no such mover was tracked.
    """
    first, shots = next(iter(runs.values()))
    ball = best_tracked([result for result, _ in runs.values()])
    if ball is None:
        return None
    truth = first.truth.select(first.truth.id == ball)
    lines = [
        _Line(title, colour, tracked(result, ball), clustered(result, snapshots, ball))
        for (title, (result, snapshots)), colour in zip(runs.items(), COLOURS, strict=False)
    ]
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    above, over_time = figure.subplots(1, 2)
    _draw_way(above, truth, lines)
    _draw_surroundings(above, first, shots)
    _draw_speeds(over_time, truth, lines, _seconds(first))
    for axes in (above, over_time):
        axes.legend(**LEGEND)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, _told(truth, lines)


def _seconds(result: SceneResult) -> F64:
    stamps = result.frames.stamp_ns
    seconds: F64 = (stamps - stamps[0]) * 1e-9
    return seconds


def _draw_way(axes: Axes, truth: TruthTable, lines: list[_Line]) -> None:
    """The true way, where it was tracked, and the track's velocity now and then."""
    axes.plot(*truth.centre_m[:, :2].T, color=TRUTH_COLOUR, linewidth=1.0, label="true way")
    for line in lines:
        axes.plot(*line.tracks.xy_m.T, ".", color=line.colour, markersize=4)
        axes.quiver(
            *line.tracks.xy_m[::ARROW_EVERY].T,
            *line.tracks.velocity_mps[::ARROW_EVERY].T,
            color=line.colour,
            angles="xy",
            scale_units="xy",
            scale=1.0 / ARROW_S,
            width=0.006,
            label=f"velocity {line.title}, {ARROW_S:g} s",
        )
    low, high = truth.centre_m[:, :2].min(axis=0), truth.centre_m[:, :2].max(axis=0)
    axes.set(xlim=(low[0] - MARGIN_M, high[0] + MARGIN_M))
    axes.set(ylim=(low[1] - MARGIN_M, high[1] + MARGIN_M), aspect="equal")
    axes.set(xlabel="x (m)", ylabel="y (m)", title=f"The {truth.label[0]} from above")


def _draw_surroundings(axes: Axes, result: SceneResult, snapshots: list[Snapshot]) -> None:
    """Points of some sweeps and the way of the vehicle, for orientation."""
    poses = [Pose.from_matrix(matrix) for matrix in result.frames.world_T_ego]
    for shot in snapshots[::SWEEP_EVERY]:
        xy_m = poses[shot.frame].apply(shot.xyz_m.astype(np.float64))[:, :2]
        axes.plot(*xy_m.T, ".", markersize=1.2, color=POINT_COLOUR, mew=0, zorder=0)
    way_m = np.array([pose.translation_m[:2] for pose in poses])
    axes.plot(*way_m.T, "--", color=VEHICLE_COLOUR, linewidth=1.0, label="way of the vehicle")
    axes.plot(*way_m[-1], "o", color=VEHICLE_COLOUR, markersize=6)


def _draw_speeds(axes: Axes, truth: TruthTable, lines: list[_Line], seconds: F64) -> None:
    speed_mps = np.hypot(*truth.velocity_mps.T)
    axes.plot(seconds[truth.frame], speed_mps, color=TRUTH_COLOUR, linewidth=1.2, label="true")
    for line in lines:
        tracks, clusters = line.tracks, line.clusters
        name = f"{line.title}: {len(tracks.frame)} frames, tracks: {tracks.tracks}"
        look: dict[str, Any] = {"color": line.colour, "markersize": 5}
        axes.plot(seconds[tracks.frame], tracks.speed_mps, ".-", linewidth=0.9, label=name, **look)
        if np.isfinite(clusters.speed_mps).any():
            name = "measured by the flow"
            axes.plot(seconds[clusters.frame], clusters.speed_mps, "x", label=name, **look)
    axes.set(xlabel="time (s)", ylabel="speed (m/s)", title="Its speed")
    axes.set_ylim(bottom=0.0)


def _told(truth: TruthTable, lines: list[_Line]) -> str:
    size_m, speed_mps = truth.size_m[0, 2], np.median(np.hypot(*truth.velocity_mps.T))
    errors = []
    for line in lines:
        errors.append(f"tracked {line.title} {_median_error(line.tracks, truth)}")
        if np.isfinite(line.clusters.speed_mps).any():
            errors.append(f"measured by the flow alone {_median_error(line.clusters, truth)}")
    return (
        f"A {truth.label[0]} of {size_m:.1f} m at {speed_mps:.1f} m/s. Median error of its "
        f"velocity in m/s: {', '.join(errors)}."
    )


def _median_error(seen: Sighting, truth: TruthTable) -> str:
    """Over the rows with a velocity; frames of the truth are in order."""
    true_mps = truth.velocity_mps[np.searchsorted(truth.frame, seen.frame)]
    error_mps = np.hypot(*(seen.velocity_mps - true_mps).T)
    measured = error_mps[np.isfinite(error_mps)]
    return f"{np.median(measured):.2f}" if len(measured) else "in no frame"

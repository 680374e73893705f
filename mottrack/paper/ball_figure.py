"""Figure 5 of the paper: a ball, an unknown object, from above and its speed over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mottrack.core.arrays import F64, I64
from mottrack.core.snapshot import ObjectTable
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.velocity_error import VelocityErrorConfig
from mottrack.geometry.iou import bev_intersection, boxes7
from mottrack.runs.run_folder import StoredScene

RUN_COLOURS = ("#2563eb", "#c2410c")
TRUTH_COLOUR, POINT_COLOUR, VEHICLE_COLOUR = "#111827", "#94a3b8", "#64748b"
MARGIN_M = 4.0  # around the path of the ball: shows what stands beside it
ARROW_S, ARROW_EVERY, SWEEP_EVERY = 0.5, 5, 8  # few enough that neither arrows nor sweeps overlap
MATCHING = VelocityErrorConfig()


class Sightings(NamedTuple):
    """Boxes of tracks or clusters that are the ball."""

    frame: I64
    xy_m: F64  # (K, 2) world frame
    velocity_mps: F64  # (K, 2) NaN where none was measured
    true_mps: F64  # (K, 2) velocity of the ball


def draw_ball(runs: dict[str, StoredScene]) -> tuple[Figure, str] | None:
    """Draw and describe the ball with most track rows in one scene of runs with different flow."""
    first = next(iter(runs.values()))
    truth, stamp_ns = first.result.truth, first.result.frames.stamp_ns
    balls = [truth.select(truth.id == i) for i in np.unique(truth.id[truth.label == "ball"])]
    rows = [sum(len(tracked(run, ball).frame) for run in runs.values()) for ball in balls]
    if not any(rows):
        return None
    ball, seconds = balls[int(np.argmax(rows))], (stamp_ns - stamp_ns[0]) * 1e-9
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    above, speeds = figure.subplots(1, 2)
    _draw_scene(above, first, ball)
    true_mps, errors = np.hypot(*ball.velocity_mps.T), []
    speeds.plot(seconds[ball.frame], true_mps, color=TRUTH_COLOUR, linewidth=1.2, label="true")
    for (title, run), colour in zip(runs.items(), RUN_COLOURS, strict=True):
        tracks, clusters = tracked(run, ball), clustered(run, ball)
        above.plot(*tracks.xy_m.T, ".", color=colour, markersize=4)
        arrows = (*tracks.xy_m[::ARROW_EVERY].T, *tracks.velocity_mps[::ARROW_EVERY].T)
        scale = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / ARROW_S, "width": 0.006}
        above.quiver(*arrows, color=colour, label=f"velocity {title}, {ARROW_S:g} s", **scale)
        shown = ((f"tracked {title}", ".-", tracks), ("measured by the flow", "x", clusters))
        for name, marker, found in shown:
            speed_mps = np.hypot(*found.velocity_mps.T)
            if np.isfinite(speed_mps).any():
                speeds.plot(seconds[found.frame], speed_mps, marker, label=name, color=colour)
                wrong_mps = found.velocity_mps - found.true_mps
                errors.append(f"{name} {np.nanmedian(np.hypot(*wrong_mps.T)):.2f}")
    speeds.set(xlabel="time (s)", ylabel="speed (m/s)", title="Its speed", ylim=(0.0, None))
    for axes in (above, speeds):
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
        axes.spines[["top", "right"]].set_visible(False)
    size = f"A ball of {ball.size_m[0, 2]:.1f} m at {np.median(true_mps):.1f} m/s."
    return figure, f"{size} Median error of its velocity in m/s: {', '.join(errors)}."


def _draw_scene(axes: Axes, scene: StoredScene, ball: TruthTable) -> None:
    """Draw the path of the ball, the points of some sweeps and the path of the vehicle."""
    axes.plot(*ball.centre_m[:, :2].T, color=TRUTH_COLOUR, linewidth=1.0, label="true path")
    world_T_ego = scene.result.frames.world_T_ego
    for shot in scene.snapshots[::SWEEP_EVERY]:
        xy_m = shot.xyz_m @ world_T_ego[shot.frame, :2, :3].T + world_T_ego[shot.frame, :2, 3]
        axes.plot(*xy_m.T, ".", markersize=1.2, color=POINT_COLOUR, mew=0, zorder=0)
    axes.plot(*world_T_ego[:, :2, 3].T, "--", color=VEHICLE_COLOUR, label="path of the vehicle")
    limits_m = [(xy_m.min() - MARGIN_M, xy_m.max() + MARGIN_M) for xy_m in ball.centre_m.T]
    axes.set(xlim=limits_m[0], ylim=limits_m[1], xlabel="x (m)", ylabel="y (m)")
    axes.set(aspect="equal", title="The ball from above")


def tracked(scene: StoredScene, ball: TruthTable) -> Sightings:
    """Return the observed track rows that are the ball."""
    tracks = scene.result.tracks.select(scene.result.tracks.observed)
    return _sightings(tracks, tracks.frame, ball)


def clustered(scene: StoredScene, ball: TruthTable) -> Sightings:
    """Return the clusters that are the ball, with the velocity that the flow gave them."""
    objects = [shot.objects for shot in scene.snapshots]
    frame = np.repeat([shot.frame for shot in scene.snapshots], [len(part) for part in objects])
    return _sightings(ObjectTable.stacked(objects), frame.astype(np.int64), ball)


def _sightings(boxes: TrackTable | ObjectTable, frame: I64, ball: TruthTable) -> Sightings:
    """Select boxes that lie by half where the LiDAR revolution before the stamp may hit the ball.

    A ball of 0.3 m at 6 m/s moves by twice its size in a revolution: beyond its box at the stamp.
    """
    shift_m = ball.velocity_mps * MATCHING.revolution_s
    centre_m = ball.centre_m - np.insert(0.5 * shift_m, 2, 0.0, axis=1)
    size_m = np.insert(ball.size_m[:, 1:], 0, np.hypot(*shift_m.T) + ball.size_m[:, 0], axis=1)
    swept = boxes7(centre_m, size_m, np.arctan2(shift_m[:, 1], shift_m[:, 0]))
    row = np.minimum(np.searchsorted(ball.frame, frame), len(ball) - 1)
    shared_m2 = bev_intersection(boxes7(boxes.centre_m, boxes.size_m, boxes.yaw_rad), swept)
    share = shared_m2[np.arange(len(row)), row] / np.prod(boxes.size_m[:, :2], axis=1)
    found = (ball.frame[row] == frame) & (share > MATCHING.significant_overlap)
    columns = (frame, boxes.centre_m[:, :2], boxes.velocity_mps, ball.velocity_mps[row])
    return Sightings(*(column[found] for column in columns))

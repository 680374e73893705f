"""An object that no detector knows, a ball if one was tracked, under a class-agnostic tracker."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.velocity_error import match_by_overlap

BALL = "ball"
MOVING_MPS = 0.5
FEWEST_ROWS = 5
"""A ball that was tracked for fewer frames a run shows nothing."""
OVERLAP = 0.3
"""Share of a cluster that must lie in the ball's box: a ball is hardly larger than a cell."""
TRUTH_COLOUR, COLOURS = "#111827", ("#9ca3af", "#c2410c", "#2563eb")
MARGIN_M = 2.0

F64 = NDArray[np.float64]


def draw_ball(results: Mapping[str, SceneResult]) -> tuple[Figure, str] | None:
    """Its way from above and its speed over time, true and tracked.

    Args:
        results: title to the result of the same scene with different flow sources.

    Returns:
        The figure and what the object is; None where none was tracked in any of them.
    """
    first = next(iter(results.values()))
    ball = _best_tracked(list(results.values()))
    if ball is None:
        return None
    label = str(first.truth.label[first.truth.id == ball][0])
    truth = first.truth.select(first.truth.id == ball)
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    above, over_time = figure.subplots(1, 2)
    _draw_truth(above, over_time, truth, _seconds(first))
    for (title, result), colour in zip(results.items(), COLOURS, strict=False):
        tracks = _tracks_of(result, ball)
        _draw_tracks(above, over_time, (title, colour), tracks, _seconds(result))
    _label(above, over_time, truth)
    above.set_title(f"The {label} from above")
    return figure, label


def _best_tracked(results: list[SceneResult]) -> int | None:
    """Of what no detector knows: the ball with most track rows, or, if none has enough, any."""
    truth = results[0].truth
    moves = np.hypot(*truth.velocity_mps.T) > MOVING_MPS
    unknown = ~np.isin(truth.label, results[0].classes) & moves
    rows = np.concatenate([_matched_ids(result) for result in results])
    found, counts = np.unique(rows[np.isin(rows, truth.id[unknown])], return_counts=True)
    if not len(found):
        return None
    is_ball = np.isin(found, truth.id[truth.label == BALL])
    enough = is_ball & (counts >= FEWEST_ROWS * len(results))
    return int(found[np.argmax(np.where(enough, counts + counts.max(), counts))])


def _matched_ids(result: SceneResult) -> NDArray[np.int64]:
    matched = match_by_overlap(result, OVERLAP)
    ids: NDArray[np.int64] = result.truth.id[matched[matched >= 0]]
    return ids


def _tracks_of(result: SceneResult, ball: int) -> TrackTable:
    matched = match_by_overlap(result, OVERLAP)
    rows = np.flatnonzero(matched >= 0)
    return result.tracks.select(rows[result.truth.id[matched[rows]] == ball])


def _seconds(result: SceneResult) -> F64:
    stamps = result.frames.stamp_ns
    seconds: F64 = (stamps - stamps[0]) * 1e-9
    return seconds


def _draw_truth(above: Axes, over_time: Axes, truth: TruthTable, seconds: F64) -> None:
    above.plot(*truth.centre_m[:, :2].T, color=TRUTH_COLOUR, linewidth=1.2, label="truth")
    speed = np.hypot(*truth.velocity_mps.T)
    over_time.plot(seconds[truth.frame], speed, color=TRUTH_COLOUR, linewidth=1.2, label="truth")


def _draw_tracks(
    above: Axes, over_time: Axes, look: tuple[str, str], tracks: TrackTable, seconds: F64
) -> None:
    title, colour = look
    xy_m, velocity = tracks.centre_m[:, :2], tracks.velocity_mps
    above.quiver(
        *xy_m.T,
        *velocity.T,
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=4.0,
        width=0.004,
        label=f"{title}: velocity, the way of 0.25 s",
    )
    speed = np.hypot(*velocity.T)
    name = f"{title} ({len(tracks)} frames, {len(np.unique(tracks.id))} tracks)"
    over_time.plot(
        seconds[tracks.frame], speed, ".-", color=colour, linewidth=0.9, markersize=5, label=name
    )


def _label(above: Axes, over_time: Axes, truth: TruthTable) -> None:
    low, high = truth.centre_m[:, :2].min(axis=0), truth.centre_m[:, :2].max(axis=0)
    above.set(xlim=(low[0] - MARGIN_M, high[0] + MARGIN_M))
    above.set(ylim=(low[1] - MARGIN_M, high[1] + MARGIN_M), aspect="equal")
    above.set(xlabel="x (m)", ylabel="y (m)")
    above.legend(fontsize=8)
    over_time.set(xlabel="time (s)", ylabel="speed (m/s)", title="Its speed")
    over_time.set_ylim(bottom=0.0)
    over_time.legend(fontsize=8)
    for axes in (above, over_time):
        axes.spines[["top", "right"]].set_visible(False)

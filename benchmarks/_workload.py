"""Road users of seven classes at a constant density with known identities: the speed workload."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects
from mottrack.core.result import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.eval.evaluation import score
from mottrack.eval.scores import ScoreConfig

CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
STEP_NS = 100_000_000
"""10 Hz, as LiDARs turn."""
SPACING_M = 7.0
"""Root of the ground that each object has for itself: a crowded junction."""
RECALL = 0.95
"""Of the detections; none is false."""
SIZE_M = (4.0, 1.8, 1.6)
LEAST_RECALL, LEAST_PRECISION = 0.8, 0.9
"""A time counts where the tracks hold this much of the truth: gaps cost some."""


class Workload(NamedTuple):
    """Detections and truth of the same frames."""

    stream: list[Objects]
    truth: TruthTable
    frames: FrameTable


def workload(count: int, frames: int, *, moving: bool = False) -> Workload:
    """Return `count` objects over that many frames; with measured velocities where `moving`."""
    rng = np.random.default_rng(count)
    side = SPACING_M * np.sqrt(count)
    place, speed = rng.uniform(0, side, (count, 2)), rng.normal(0, 4, (count, 2))
    label = np.array(CLASSES)[np.arange(count) % len(CLASSES)]
    yaw = rng.uniform(-np.pi, np.pi, count)
    stream, centres = [], []
    for k in range(frames):
        centres.append(np.column_stack([place + 0.1 * k * speed, np.zeros(count)]))
        seen = np.flatnonzero(rng.random(count) < RECALL)
        noise = np.column_stack([rng.normal(0, 0.15, (len(seen), 2)), np.zeros(len(seen))])
        measured, strength = rng.normal(0, 0.5, (len(seen), 2)), rng.uniform(0.3, 1, len(seen))
        velocity = None
        if moving:
            spread = np.tile([[0.3, 0.1], [0.1, 0.2]], (len(seen), 1, 1))
            valid = np.ones(len(seen), bool)
            velocity = VelocityMeasurement(speed[seen] + measured, spread, valid)
        stream.append(
            Objects(
                stamp_ns=k * STEP_NS,
                frame="world",
                centre_m=centres[k][seen] + noise,
                size_m=np.tile(SIZE_M, (len(seen), 1)),
                yaw_rad=yaw[seen],
                label=label[seen],
                score=strength,
                velocity=velocity,
            )
        )
    rows = count * frames
    truth = TruthTable(
        frame=np.repeat(np.arange(frames), count),
        id=np.tile(np.arange(count), frames),
        label=np.tile(label, frames),
        centre_m=np.concatenate(centres),
        size_m=np.tile(SIZE_M, (rows, 1)),
        yaw_rad=np.tile(yaw, frames),
        velocity_mps=np.tile(speed, (frames, 1)),
        num_points=np.full(rows, -1),
        interpolated=np.zeros(rows, np.bool_),
    )
    return Workload(stream, truth, _frames(frames))


def _frames(count: int) -> FrameTable:
    return FrameTable(
        stamp_ns=np.arange(count) * STEP_NS,
        token=np.array([str(k) for k in range(count)]),
        world_T_ego=np.tile(np.eye(4), (count, 1, 1)),
        labelled_azimuth_rad=np.tile([-np.pi, np.pi], (count, 1)),
        annotated=np.ones(count, np.bool_),
    )


class Check(NamedTuple):
    """What the tracks of a timed run are worth, by the official rules."""

    amota: float
    mota: float
    switches: int
    holds: bool
    """Whether recall and precision are high enough for the time to count."""


def check(work: Workload, tracks: TrackTable, first: int) -> Check:
    """Return the figures of tracks against the workload's truth, from the frame `first` on."""
    truth = work.truth.select(work.truth.frame >= first)
    result = SceneResult("workload", work.frames, truth, tracks.select(tracks.frame >= first))
    scores = score([result], ScoreConfig()).overall
    clear = scores.clear
    holds = clear.recall >= LEAST_RECALL and clear.precision >= LEAST_PRECISION
    return Check(scores.amota, scores.mean_mota, clear.switches, holds)

"""Point-wise flow of a scene: what a flow source says and what annotated tracks say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver, GroundMap, Scene
from mottrack.core.motion import FlowField
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose, rotation_z
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.eval.sceneflow.categories import BACKGROUND, UNKNOWN, category_numbers
from mottrack.eval.sceneflow.points import CLOSE_M, DYNAMIC_M, PAIR_S, FlowPoints
from mottrack.experiment.experiment import Experiment
from mottrack.lidar.ground import GroundConfig, find_ground
from mottrack.lidar.in_boxes import points_in_boxes
from mottrack.pipeline.mirrored import MirroredScene
from mottrack.pipeline.sweep_pairs import PairConfig, SweepPairs

REACH_M = 50.0
"""Half the side of the square in which the challenge evaluates points."""
GROUND_M = 0.3
"""Points up to this above the ground are ground: Argoverse's threshold, and our flow's."""
BOX_GROWTH_M = np.array([0.2, 0.2, 0.0])
"""Added to the length and width of a true box, as by the challenge: labels are a little tight."""
LONGEST_PAIR_S = 0.15
"""Annotated frames up to this apart are a pair of the challenge (10 Hz); beyond it the motion
between them is scaled to 0.1 s."""
LONGEST_STEP_S = 0.75
"""Annotated frames further apart say nothing of the motion; nuScenes' are 0.5 s apart."""

PointChoice = Callable[[str, int], Mask | None]
"""Which points of a sweep are evaluated, (N,) by scene and stamp; None for none of them."""


class Sample(NamedTuple):
    """The evaluated points of one sweep."""

    stamp_ns: int
    points: FlowPoints


def scene_flow_points(
    experiment: Experiment, scene: Scene, choice: PointChoice | None = None
) -> list[Sample]:
    """Return the evaluated points of every annotated frame of a scene that has a next one.

    With a `choice` that names a frame without annotations (of a test split) its points are there
    too, without a known truth: an estimate for the challenge's files.

    The source is fed with the scene backwards (`MirroredScene`), so its field at a sweep points to
    the next one. A point takes the velocity of its cell; one in a cell that was not measured, or
    beyond the grid, moves with the ground. The field has no vertical part.

    Args:
        experiment: its flow source is used.
        scene: with sweeps and annotations.
        choice: the evaluated points; by default those near the vehicle that are not ground.

    Raises:
        MottrackError: the data are damaged, or the source refuses its input.
    """
    source = experiment.flow.make(grid=experiment.settings.grid.grid())
    frames = [scene.frame(index) for index in range(len(scene))]
    annotated = [i for i, frame in enumerate(frames) if frame.truth is not None]
    following = dict(pairwise(annotated))
    if choice is not None:
        following = dict(pairwise(range(len(frames)))) | following
    found = []
    for index, field in fields(experiment, source, MirroredScene(scene), frozenset(following)):
        if index not in following:
            continue
        now, after = frames[index], frames[following[index]]
        if seconds_between(now.stamp_ns, after.stamp_ns) > LONGEST_STEP_S:
            continue
        sweep = scene.sweep(index)
        keep = choice(scene.name, now.stamp_ns) if choice else evaluated(scene, sweep)
        if keep is None:
            continue
        if len(keep) != len(sweep):
            expected = f"{len(sweep)}, the points of the sweep"
            raise InputError(f"mask of {scene.name} at {now.stamp_ns}", len(keep), expected)
        found.append(Sample(now.stamp_ns, flow_points(Pair(now, after), sweep.select(keep), field)))
    return found[::-1]


def fields(
    experiment: Experiment, source: FlowSource, mirrored: MirroredScene, needed: frozenset[int]
) -> Iterator[tuple[int, FlowField | None]]:
    """Yield the index of each frame of the recording, from its end, and the field measured there.

    The first frame has no field: nothing follows it. A source without state is asked only for the
    frames that are needed.
    """
    stateful = source.stateful
    pairs = SweepPairs(PairConfig.of(experiment.settings, source))
    source.reset()
    for index in range(len(mirrored)):
        frame, sweep = mirrored.frame(index), mirrored.sweep(index)
        if isinstance(source, FrameObserver):
            source.observe(frame)
        past = pairs.push(sweep)
        if not past and stateful:
            source.reset()
        original = mirrored.original(index)
        wanted = bool(past) and (stateful or original in needed)
        yield original, source.estimate(past, sweep) if wanted else None


def evaluated(scene: Scene, sweep: Sweep) -> Mask:
    """Return the points within the challenge's square that are not ground, (N,).

    The ground is the map's where the scene has one, else it is found in the sweep.
    """
    near = np.abs(sweep.xyz_m[:, :2]).max(axis=1, initial=0.0) <= REACH_M
    height_m = np.full(len(sweep), np.nan)
    if isinstance(scene, GroundMap):
        world_m = sweep.world_T_ego.apply(sweep.xyz_m)
        height_m = world_m[:, 2] - scene.ground_height(world_m[:, :2])
    if np.isnan(height_m).all() and len(sweep):
        height_m = find_ground(sweep.xyz_m, GroundConfig(reach_m=REACH_M)).height_m
    kept: Mask = near & ~(height_m <= GROUND_M)
    return kept


@dataclass(frozen=True)
class Pair:
    """An annotated frame and another one, to which the flow of its points leads."""

    now: Frame
    other: Frame
    """The next frame; in a run, which knows no later ones, the frame before."""

    @property
    def step_s(self) -> float:
        """Time between them, positive."""
        return abs(seconds_between(self.now.stamp_ns, self.other.stamp_ns))

    @property
    def scaled(self) -> bool:
        """Whether they are too far apart for a pair of the challenge."""
        return self.step_s > LONGEST_PAIR_S

    @property
    def flow_s(self) -> float:
        """Time over which flow is a displacement."""
        return PAIR_S if self.scaled else self.step_s

    @property
    def other_T_now(self) -> Pose:
        """The vehicle's own motion; none where motion is scaled: it is taken out there."""
        if self.scaled:
            return Pose.identity()
        return self.other.world_T_ego.inverse() @ self.now.world_T_ego


def flow_points(pair: Pair, sweep: Sweep, field: FlowField | None) -> FlowPoints:
    """Return points with their flow as the challenge's files have it: ego motion included."""
    return TruePoints.of(pair, sweep).estimated(field)


@dataclass(frozen=True)
class TruePoints:
    """Points of a sweep and what annotated tracks say of them, for any number of estimates."""

    pair: Pair
    xyz_m: F64
    """(N, 3) ego frame."""
    motion: Motion

    @classmethod
    def of(cls, pair: Pair, sweep: Sweep) -> TruePoints:
        """Look up the true motion of the points of a sweep."""
        return cls(pair, sweep.xyz_m.astype(np.float64), true_motion(pair, sweep))

    def estimated(self, field: FlowField | None) -> FlowPoints:
        """Return the points with the flow of a field, whose velocities lead away from `other`.

        A source that is fed backwards, and one in a run whose `other` is the frame before, both
        say how the content of a cell came from there: the way there is its opposite.
        """
        xyz_m, pair = self.xyz_m, self.pair
        said_m = np.zeros_like(xyz_m)
        if field is not None:
            said_m[:, :2] = -cell_velocities(field, xyz_m) * pair.flow_s
        rotation = pair.other_T_now.rotation
        ego_motion_m = pair.other_T_now.apply(xyz_m) - xyz_m
        moved_m = self.motion.moved_m
        return FlowPoints(
            truth_m=ego_motion_m + moved_m @ rotation.T,
            estimate_m=ego_motion_m + said_m @ rotation.T,
            category=self.motion.category,
            dynamic=np.linalg.norm(moved_m, axis=1) >= DYNAMIC_M,
            dynamic_estimate=np.linalg.norm(said_m, axis=1) >= DYNAMIC_M,
            close=np.abs(xyz_m[:, :2]).max(axis=1, initial=0.0) <= CLOSE_M,
            valid=self.motion.valid & _labelled(pair.now, xyz_m),
            ego_motion_m=ego_motion_m,
            xy_m=xyz_m[:, :2],
        )


def cell_velocities(field: FlowField, xyz_m: F64) -> F64:
    """Return the velocity of each point's cell (N, 2), 0 where it was not measured."""
    row, column, inside = field.grid.cells(xyz_m)
    measured = inside & field.valid[row, column]
    return np.where(measured[:, None], field.velocity_mps[row, column], 0.0).astype(np.float64)


class Motion(NamedTuple):
    """How N points move over the ground, by annotated tracks."""

    moved_m: F64
    """(N, 3) displacement over the ground, axes of the vehicle's frame."""
    category: I64
    """(N,)"""
    valid: Mask
    """(N,)"""


def true_motion(pair: Pair, sweep: Sweep) -> Motion:
    """Return what annotated tracks say of every point: it moves rigidly with its box."""
    truth, later = pair.now.truth, pair.other.truth
    if truth is None or later is None or not len(truth):
        none, known = np.full(len(sweep), BACKGROUND), truth is not None and later is not None
        return Motion(np.zeros((len(sweep), 3)), none, np.full(len(sweep), known))
    boxes = truth.transformed(sweep.world_T_ego.inverse(), "ego")
    size_m = boxes.size_m + BOX_GROWTH_M
    inside = points_in_boxes(sweep.xyz_m, boxes.centre_m, size_m, boxes.yaw_rad)
    box = inside.first_box(len(sweep))
    next_of = _indices(truth.id, later.id)
    numbers = category_numbers(truth.label.tolist())
    category = np.where(box >= 0, numbers[box], BACKGROUND)
    valid = (box < 0) | ((next_of[box] >= 0) & (category != UNKNOWN))
    world_m = sweep.world_T_ego.apply(sweep.xyz_m)
    moved_m = np.zeros((len(sweep), 3))
    for k in np.unique(box[(box >= 0) & valid]).tolist():
        rows = box == k
        moved_m[rows] = _carried(truth, later, (k, int(next_of[k])), world_m[rows]) - world_m[rows]
    to_ego = sweep.world_T_ego.rotation
    return Motion(moved_m @ to_ego * (pair.flow_s / pair.step_s), category, valid)


def _carried(truth: Truth, later: Truth, rows: tuple[int, int], world_m: F64) -> F64:
    """Return where the points of a box are when it has become the other one."""
    k, j = rows
    turn = rotation_z(float(later.yaw_rad[j] - truth.yaw_rad[k]))
    carried: F64 = (world_m - truth.centre_m[k]) @ turn.T + later.centre_m[j]
    return carried


def _indices(wanted: I64, among: I64) -> I64:
    """Return where each value is in the others, -1 where it is not."""
    row_of = {int(value): row for row, value in enumerate(among)}
    return np.array([row_of.get(int(value), -1) for value in wanted], np.int64)


def _labelled(frame: Frame, xyz_m: F64) -> Mask:
    if frame.labelled_azimuth_rad is None:
        return np.ones(len(xyz_m), np.bool_)
    right, left = frame.labelled_azimuth_rad
    azimuth = np.arctan2(xyz_m[:, 1], xyz_m[:, 0])
    return (azimuth >= right) & (azimuth <= left)

"""Ways in which detections and flow get worse, by an amount in the unit of each.

Every draw depends on the scene, the kind of damage and the frame alone: all trackers meet the same
damage, whatever they do with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.core.objects import Objects
from mottrack.core.pose import Pose

CLUTTER_REACH_M = 50.0
"""False boxes lie in a square of this half side around the vehicle: nuScenes scores cars to it."""
BURST_PERIOD_S = 4.0
"""A sector goes blind once in this time, for the amount of seconds."""
BURST_SECTOR_RAD = np.pi / 2
DRIFT_YAW_RADPM = 0.002
"""Heading drift for each metre of drift: 1 m/s turns by 0.1 degree a second, as odometry does."""


@dataclass(frozen=True)
class Moment:
    """What a damage may depend on."""

    detections: Objects
    """World frame."""
    world_T_ego: Pose
    since_s: float
    """Time since the scene began."""
    rng: np.random.Generator


Detections = Callable[[Moment, float], Objects]


@dataclass(frozen=True)
class Damage:
    """One kind of damage."""

    title: str
    unit: str
    steps: tuple[float, ...]
    """Amounts, from none to where hardly a tracker is of use."""
    detections: Detections | None = None
    """None where it is the scene or the flow that gets worse."""


def dropout(moment: Moment, share: float) -> Objects:
    """Leave out each detection with this probability."""
    return moment.detections.select(moment.rng.random(len(moment.detections)) >= share)


def burst(moment: Moment, blind_s: float) -> Objects:
    """Leave out a sector of 90 degrees for so many of every four seconds."""
    number, within_s = divmod(moment.since_s, BURST_PERIOD_S)
    if within_s >= blind_s:
        return moment.detections
    middle = number * 2.4  # the golden angle: sectors that are unlike those before
    turned = np.angle(np.exp(1j * (_azimuths(moment) - middle)))
    return moment.detections.select(np.abs(turned) > BURST_SECTOR_RAD / 2)


def _azimuths(moment: Moment) -> F64:
    ego_m = moment.world_T_ego.inverse().apply(moment.detections.centre_m)
    return np.asarray(np.arctan2(ego_m[:, 1], ego_m[:, 0]))


def jitter(moment: Moment, sigma_m: float) -> Objects:
    """Move each box over the ground by normal noise."""
    boxes = moment.detections
    noise_m = np.zeros((len(boxes), 3))
    noise_m[:, :2] = moment.rng.normal(0.0, sigma_m, (len(boxes), 2))
    return replace(boxes, centre_m=boxes.centre_m + noise_m)


def size_noise(moment: Moment, sigma: float) -> Objects:
    """Scale each side of each box by a log-normal factor."""
    boxes = moment.detections
    return replace(
        boxes, size_m=boxes.size_m * np.exp(moment.rng.normal(0, sigma, (len(boxes), 3)))
    )


def heading_noise(moment: Moment, sigma_rad: float) -> Objects:
    """Turn each box by normal noise."""
    boxes = moment.detections
    return replace(boxes, yaw_rad=boxes.yaw_rad + moment.rng.normal(0.0, sigma_rad, len(boxes)))


def clutter(moment: Moment, boxes_a_frame: float) -> Objects:
    """Add false boxes (Poisson) that look like the true detections of the frame, elsewhere."""
    boxes, rng = moment.detections, moment.rng
    count = rng.poisson(boxes_a_frame) if len(boxes) else 0
    copies = boxes.select(rng.integers(0, max(len(boxes), 1), count))
    xy_m = rng.uniform(-CLUTTER_REACH_M, CLUTTER_REACH_M, (count, 2))
    place = moment.world_T_ego.apply(np.column_stack([xy_m, np.zeros(count)]))
    place[:, 2] = copies.centre_m[:, 2]
    yaw = rng.uniform(-np.pi, np.pi, count)
    return joined(boxes, replace(copies, centre_m=place, yaw_rad=yaw))


def confusion(moment: Moment, share: float) -> Objects:
    """Give each box with this probability the label of another box of the frame."""
    boxes, rng = moment.detections, moment.rng
    if not len(boxes):
        return boxes
    other = boxes.label[rng.integers(0, len(boxes), len(boxes))]
    return replace(boxes, label=np.where(rng.random(len(boxes)) < share, other, boxes.label))


def lost_frame(moment: Moment, share: float) -> Objects:
    """Leave out all detections of a frame with this probability."""
    lost: Mask = np.full(len(moment.detections), moment.rng.random() < share)
    return moment.detections.select(~lost)


def joined(boxes: Objects, more: Objects) -> Objects:
    """Return both; what detectors report beside boxes (velocity, hulls) is left out."""
    names = ("centre_m", "size_m", "yaw_rad", "label", "score")
    both: dict[str, Any] = {
        name: np.concatenate([getattr(boxes, name), getattr(more, name)]) for name in names
    }
    return Objects(stamp_ns=boxes.stamp_ns, frame=boxes.frame, **both)


def drift_pose(since_s: float, speed_mps: float) -> Pose:
    """Return where the world seems to have gone: it slides along x and turns."""
    gone_m = speed_mps * since_s
    return Pose.from_yaw(DRIFT_YAW_RADPM * gone_m, (gone_m, 0.0, 0.0))


_SHARES = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8)  # from none to most of the detections
LATE, DRIFT = "late", "drift"
FLOW_NOISE, FLOW_LOST, FLOW_LATE = "flow_noise", "flow_lost", "flow_late"
# levels from none to far beyond what a working detector does
DAMAGES = {
    "dropout": Damage("Dropped detections", "share", _SHARES, dropout),
    "burst": Damage("Blind sector", "s of 4 s", (0.0, 0.5, 1.0, 2.0, 3.0), burst),
    "jitter": Damage("Position noise", "m", (0.0, 0.1, 0.25, 0.5, 1.0, 2.0), jitter),
    "size": Damage("Size noise", "log", (0.0, 0.1, 0.2, 0.4, 0.8), size_noise),
    "heading": Damage("Heading noise", "rad", (0.0, 0.1, 0.3, 0.8, 1.6), heading_noise),
    "clutter": Damage("False boxes", "a frame", (0.0, 2.0, 5.0, 10.0, 20.0, 50.0), clutter),
    "confusion": Damage("Swapped labels", "share", (0.0, 0.05, 0.1, 0.2, 0.4), confusion),
    "lost_frame": Damage("Lost frames", "share", _SHARES, lost_frame),
    LATE: Damage("Late detections", "frames", (0.0, 1.0, 2.0, 4.0)),
    DRIFT: Damage("Pose drift", "m/s", (0.0, 0.1, 0.3, 1.0, 3.0)),
    FLOW_NOISE: Damage("Flow noise", "m/s", (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)),
    FLOW_LOST: Damage("Lost motions", "share of cells", _SHARES),
    FLOW_LATE: Damage("Late flow", "fields", (0.0, 1.0, 2.0, 4.0)),
}

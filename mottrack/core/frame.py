"""Pose, detections and truth of one time step of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from mottrack.core.checks import MAX_PLACE_M, require_instance, require_within, set_stamp
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects, Truth
from mottrack.core.pose import Pose


@dataclass(frozen=True, slots=True)
class Frame:
    """What a data set knows at one stamp, apart from the sweep itself.

    Raises:
        InputError: detections or truth are not in the world frame, the pose is no `Pose` or
            no place on Earth, or the labelled azimuths are not ascending angles in [-pi, pi].
    """

    stamp_ns: int
    world_T_ego: Pose
    detections: Objects | None = None
    """World frame; None where no detector ran, empty where it found nothing."""
    truth: Truth | None = None
    """World frame; None where the frame is not annotated, empty where there was no object."""
    is_key: bool = True
    """Whether trackers step and scores count at this stamp (nuScenes: key frames at 2 Hz)."""
    token: str = ""
    """The data set's own name of the frame (nuScenes: the sample token)."""
    labelled_azimuth_rad: tuple[float, float] | None = None
    """(right, left) azimuth in the ego frame between which objects are labelled, right < left;
    None: all around. KITTI labels what its camera sees: elsewhere a track or a moving cell is no
    error."""

    def __post_init__(self) -> None:
        set_stamp(self)
        require_instance("world_T_ego", self.world_T_ego, Pose)
        require_within(
            "world_T_ego.translation_m", self.world_T_ego.translation_m, MAX_PLACE_M, "m"
        )
        right, left = self.labelled_azimuth_rad or (-pi, pi)
        if not -pi <= right < left <= pi:
            raise InputError("labelled_azimuth_rad", [right, left], "right < left in [-pi, pi]")
        for name, boxes in (("detections", self.detections), ("truth", self.truth)):
            if boxes is not None and boxes.frame != "world":
                raise InputError(f"frame of {name}", repr(boxes.frame), "'world'")

"""Scenes as logs of 123D, written by py123d's own writer."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mottrack.core import Pose, Scene
from mottrack.formats.rigid import quaternion_wxyz, yaw_quaternions

LABELS = {"car": "REGULAR_VEHICLE", "truck": "TRUCK", "bus": "BUS", "pedestrian": "PEDESTRIAN"}
LABELS |= {"bicycle": "BICYCLE", "motorcycle": "MOTORCYCLE", "trailer": "VEHICULAR_TRAILER"}


def write_logs(root: Path, scenes: Iterable[Scene], split: str = "av2-sensor_val") -> None:
    """Write each scene with the labels of Argoverse 2; others become a dog, which moves too."""
    from py123d.api.scene.arrow.arrow_log_writer import ArrowLogWriter
    from py123d.api.scene.arrow.utils.log_writer_config import LogWriterConfig
    from py123d.datatypes import LogMetadata

    config = LogWriterConfig(lidar_store_option="binary", lidar_codec="ipc", write_route=False)
    for scene in scenes:
        writer = ArrowLogWriter(config, root, root / "sensors")
        writer.reset(LogMetadata("av2-sensor", split, scene.name, "nowhere"))
        for index in range(len(scene)):
            writer.write_sync(modalities(scene, index))
        writer.close()


def modalities(scene: Scene, index: int):
    from py123d.datatypes import Timestamp
    from py123d.datatypes.detections.box_detections import (
        BoxDetectionAttributes,
        BoxDetectionSE3,
        BoxDetectionsSE3,
    )
    from py123d.datatypes.detections.box_detections_metadata import BoxDetectionsSE3Metadata
    from py123d.datatypes.sensors.lidar import (
        Lidar,
        LidarFeature,
        LidarID,
        LidarMergedMetadata,
        LidarMetadata,
    )
    from py123d.datatypes.vehicle_state.ego_state import EgoStateSE3
    from py123d.datatypes.vehicle_state.ego_state_metadata import EgoStateSE3Metadata
    from py123d.geometry import BoundingBoxSE3, PoseSE3
    from py123d.parser.base_dataset_parser import ModalitiesSync
    from py123d.parser.registry import AV2SensorBoxDetectionLabel

    def se3(pose: Pose) -> PoseSE3:
        return PoseSE3(*pose.translation_m, *quaternion_wxyz(pose.rotation))

    frame, sweep = scene.frame(index), scene.sweep(index)
    time = Timestamp.from_us(frame.stamp_ns // 1000)
    still = PoseSE3.identity()
    vehicle = EgoStateSE3Metadata("car", 1.9, 4.8, 1.5, 2.8, still, still)
    ego = EgoStateSE3.from_imu(se3(frame.world_T_ego), vehicle, time)
    boxes = []
    for row in range(len(frame.truth)):
        name = LABELS.get(str(frame.truth.label[row]), "DOG")
        quaternion = yaw_quaternions(frame.truth.yaw_rad[row : row + 1])[0]
        centre = PoseSE3(*frame.truth.centre_m[row], *quaternion)
        attributes = BoxDetectionAttributes(
            AV2SensorBoxDetectionLabel[name],
            str(frame.truth.id[row]),
            max(0, int(frame.truth.num_points[row])),
        )
        boxes.append(BoxDetectionSE3(attributes, BoundingBoxSE3(centre, *frame.truth.size_m[row])))
    labels = BoxDetectionsSE3Metadata(AV2SensorBoxDetectionLabel)
    mounting = PoseSE3(*sweep.origin_m, 1.0, 0.0, 0.0, 0.0)
    lidar = LidarMetadata("top", LidarID.LIDAR_TOP, mounting)
    features = {
        LidarFeature.INTENSITY.serialize(): np.round(255 * sweep.reflectance).astype(np.uint8),
        LidarFeature.IDS.serialize(): np.full(len(sweep), int(LidarID.LIDAR_TOP), np.uint8),
    }
    cloud = Lidar(
        time, time, LidarMergedMetadata({LidarID.LIDAR_TOP: lidar}), sweep.xyz_m, features
    )
    return ModalitiesSync(time, [ego, BoxDetectionsSE3(boxes, time, labels), cloud])

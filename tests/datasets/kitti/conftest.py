"""A KITTI data set of three frames, one car driving at 10 m/s, written by hand."""

import numpy as np
import pytest

CALIBRATION = """P2: 700 0 600 40 0 700 170 0 0 0 1 0
R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27
Tr_imu_velo 1 0 0 -0.8 0 1 0 0.3 0 0 1 -0.8
"""


@pytest.fixture
def kitti_root(tmp_path):
    training = tmp_path / "training"
    for folder in ("calib", "label_02", "poses", "velodyne/0000"):
        (training / folder).mkdir(parents=True)
    (training / "calib/0000.txt").write_text(CALIBRATION)
    labels = ["0 -1 DontCare -1 -1 -10 0 0 9 9 -1000 -1000 -1000 -10 -1 -1 -1"]
    poses = []
    for frame in range(3):
        # the ego vehicle drives 0.5 m a frame, the car 1.0 m, both forward
        z = 20.0 + 0.5 * frame
        labels.append(f"{frame} 7 Van 0 0 0 1 2 3 4 1.5 1.8 4.2 2.0 1.6 {z} {-np.pi / 2}")
        poses.append(f"1 0 0 0 0 1 0 0 0 0 1 {0.5 * frame}")
        points = np.array([[z + 0.27, -2.0, -1.0, 0.5], [5, 5, 0, 0.1]], dtype="<f4")
        points.tofile(training / f"velodyne/0000/{frame:06d}.bin")
    (training / "label_02/0000.txt").write_text("\n".join(labels) + "\n")
    (training / "poses/0000.txt").write_text("\n".join(poses) + "\n")
    cars = tmp_path / "detections/pointrcnn/Car"
    cars.mkdir(parents=True)
    (cars / "0000.txt").write_text("1,2,1,2,3,4,3.5,1.5,1.8,4.2,2.0,1.6,20.5,-1.5707963,0.1\n")
    return tmp_path

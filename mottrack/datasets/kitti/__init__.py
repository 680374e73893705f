"""KITTI tracking: Velodyne sweeps, labels, calibration, poses and text detections."""

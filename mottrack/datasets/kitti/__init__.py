"""KITTI tracking: labels, sweeps and poses as downloaded, detections in AB3DMOT's format."""

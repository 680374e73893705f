"""Readers and writers of data sets.

A package each: `config.py` (settings), `dataset.py` (the data set and its scenes), readers of its
files, `write.py`. They share `scenes.py` (names and indices), `checks.py` (what points, boxes and
poses must satisfy), `rigid.py` (rotations) and `scene_boxes.py` (truth and detections as arrays).
Files themselves are read by `mottrack.formats`.
"""

DATASETS: dict[str, str] = {
    "argoverse2": "mottrack.datasets.argoverse2.dataset:Argoverse2",
    "folder": "mottrack.datasets.folder.dataset:Folder",
    "kitti": "mottrack.datasets.kitti.dataset:Kitti",
    "nuscenes": "mottrack.datasets.nuscenes.dataset:NuScenes",
    "ros": "mottrack.datasets.ros.dataset:RosLogs",
    "synthetic": "mottrack.datasets.synthetic:SyntheticDataset",
}
"""Name in a configuration to `module:Class`; nothing is imported before it is asked for."""

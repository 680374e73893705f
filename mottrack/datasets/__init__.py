"""Data sets: where sweeps, detections and truth come from."""

DATASETS: dict[str, str] = {
    "argoverse2": "mottrack.datasets.argoverse2.dataset:Argoverse2",
    "folder": "mottrack.datasets.folder.dataset:Folder",
    "kitti": "mottrack.datasets.kitti.dataset:Kitti",
    "nuscenes": "mottrack.datasets.nuscenes.dataset:NuScenes",
    "ros": "mottrack.datasets.ros.dataset:RosLogs",
    "synthetic": "mottrack.datasets.synthetic:SyntheticDataset",
}
"""Name in a configuration to `module:Class`; nothing is imported before it is asked for."""

"""Readers and writers of data sets.

A package each: `config.py` (settings), `dataset.py` (the data set and its scenes), readers of its
files, `write.py`. They share `scenes.py` (names and indices), `checks.py` (what points, boxes and
poses must satisfy), `rigid.py` (rotations) and `scene_boxes.py` (truth and detections as arrays).
Files themselves are read by `mottrack.formats`.
"""

from mottrack.core.interfaces import TableEntry

DATASETS: dict[str, TableEntry] = {
    "argoverse2": TableEntry(
        "mottrack.datasets.argoverse2.dataset:Argoverse2", "The logs of one Argoverse 2 split."
    ),
    "folder": TableEntry(
        "mottrack.datasets.folder.dataset:Folder",
        "The logs of a folder, in the format of docs/own_logs.md.",
    ),
    "kitti": TableEntry(
        "mottrack.datasets.kitti.dataset:Kitti",
        "The 21 training or 29 test sequences of KITTI tracking, or those that are there.",
    ),
    "nuscenes": TableEntry(
        "mottrack.datasets.nuscenes.dataset:NuScenes",
        "The scenes of one version and split, without the devkit.",
    ),
    "py123d": TableEntry(
        "mottrack.datasets.py123d.dataset:Py123d",
        "The logs of a folder in 123D's Arrow format, whatever data set they come from.",
    ),
    "ros": TableEntry(
        "mottrack.datasets.ros.dataset:RosLogs",
        "The logs of a folder, ROS 2 or ROS 1, a scene each: PointCloud2, Odometry or tf, boxes.",
    ),
    "t4": TableEntry(
        "mottrack.datasets.nuscenes.t4:T4",
        "The data sets of a folder in Autoware's T4 format, a scene each.",
    ),
    "truckscenes": TableEntry(
        "mottrack.datasets.nuscenes.dataset:TruckScenes",
        "The scenes of one version and split of MAN TruckScenes, six LiDARs in one sweep.",
    ),
    "synthetic": TableEntry(
        "mottrack.datasets.synthetic:SyntheticDataset",
        "Procedural driving scenes, from one seed, bit-identical on every run.",
    ),
}
"""Name in a configuration to its class."""

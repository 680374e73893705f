"""The embedded world: procedural driving scenes, scanned by a simulated LiDAR."""

from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.datasets.synthetic.scene import SyntheticScene
from mottrack.datasets.synthetic.sweep_maker import PointTruth

__all__ = ["PointTruth", "SyntheticConfig", "SyntheticDataset", "SyntheticScene"]

"""The embedded world: procedural driving scenes, scanned by a simulated LiDAR."""

from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.datasets.synthetic.scene import SyntheticScene
from mottrack.datasets.synthetic.sweep_maker import PointTruth
from mottrack.datasets.synthetic.training_pair import TrainingConfig, TrainingPair, training_pair

__all__ = [
    "PointTruth",
    "SyntheticConfig",
    "SyntheticDataset",
    "SyntheticScene",
    "TrainingConfig",
    "TrainingPair",
    "training_pair",
]

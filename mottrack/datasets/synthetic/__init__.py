"""The embedded world as a data set."""

from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.datasets.synthetic.scene import SyntheticScene

__all__ = ["SyntheticConfig", "SyntheticDataset", "SyntheticScene"]

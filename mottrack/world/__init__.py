"""The embedded world: procedural roads and traffic, scanned by a simulated LiDAR."""

from mottrack.world.sweep_maker import PointTruth
from mottrack.world.training_pair import TrainingConfig, TrainingPair, training_pair

__all__ = ["PointTruth", "TrainingConfig", "TrainingPair", "training_pair"]

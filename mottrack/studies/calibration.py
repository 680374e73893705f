"""Calibrates the covariance of trained weights on held-out pairs of the embedded world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mottrack.flow.pillarflow.calibration import Calibration, fit_calibration
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.raster import network_cells
from mottrack.flow.pillarflow.training.crop import CropConfig
from mottrack.flow.pillarflow.training.example import EXAMPLE_GRID
from mottrack.flow.pillarflow.training.making import ExampleMaker
from mottrack.flow.pillarflow.training.validation import Scores, cell_errors
from mottrack.flow.pillarflow.weights_file import load_weights, save_weights
from mottrack.studies.world_pairs import world_pair

SEED = 930_001
"""No training and no table uses it."""


@dataclass(frozen=True)
class Calibrated:
    """What was fitted, and what the other half of the pairs says about it."""

    calibration: Calibration
    before: Scores
    """With the calibration that the file had."""
    after: Scores
    """With the new one."""


def calibrate_weights(file: Path, pairs: int, on_pair: Callable[[int, int], None]) -> Calibrated:
    """Fits on every second pair, scores on the others, and writes the file anew.

    Raises:
        DataError: the file is not usable.
    """
    weights = load_weights(file)
    shape = weights.network.config
    cells = network_cells(EXAMPLE_GRID, shape.cell_m, shape.multiple)
    maker = ExampleMaker(ground=weights.ground_removed)
    examples = []
    for index in range(pairs):
        examples.append(maker.make(world_pair(SEED, index, {})))
        on_pair(index + 1, pairs)
    network = channels_last(weights.network)
    fitted = fit_calibration(cell_errors(network, examples[::2], cells, CropConfig()).residuals)
    others = cell_errors(network, examples[1::2] or examples, cells, CropConfig())
    network.eval()
    save_weights(file, replace(weights, calibration=fitted))
    return Calibrated(fitted, others.scores(weights.calibration), others.scores(fitted))

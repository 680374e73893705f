"""Calibrate the covariance of trained weights on held-out pairs of the embedded world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mottrack.flow.pillarflow.calibration import Calibration, fit_calibration
from mottrack.flow.pillarflow.layers import channels_last
from mottrack.flow.pillarflow.training.config import CropConfig
from mottrack.flow.pillarflow.training.examples import ExampleBuilder
from mottrack.flow.pillarflow.training.validation import Scores, cell_errors
from mottrack.flow.pillarflow.weights_file import load_weights, save_weights
from mottrack.studies.training_examples import world_pair

SPREAD_S = 0.05
"""The ages of older sweeps of real drives differ from the wanted ones by half a period at 10 Hz."""
SEED = 930_001
"""Seed of the pairs: no training and no table uses it."""


@dataclass(frozen=True)
class CalibrationStudy:
    """A fitted calibration and the scores on the pairs that it was not fitted to."""

    calibration: Calibration
    before: Scores
    """With the calibration that the file had."""
    after: Scores
    """With the new one."""


def calibrate_weights(
    file: Path, pairs: int, on_pair: Callable[[int, int], None]
) -> CalibrationStudy:
    """Fit on every second pair, score on the others, and write the file anew.

    Args:
        file: the weights.
        pairs: number of pairs, at least 2 for scores on pairs that were not fitted to.
        on_pair: is called with (done, total) after each pair.

    Raises:
        DataError: the file is not usable.
    """
    weights = load_weights(file)
    builder = ExampleBuilder(remove_ground=weights.ground_removed)
    ages_s = weights.network.config.older_ages_s
    world = {"older_ages_s": ages_s, "older_spread_s": SPREAD_S} if ages_s else {}
    examples = []
    for index in range(pairs):
        examples.append(builder.build(world_pair(SEED, index, world)))
        on_pair(index + 1, pairs)
    network = channels_last(weights.network)
    fitted = fit_calibration(cell_errors(network, examples[::2], CropConfig()).residuals)
    others = cell_errors(network, examples[1::2] or examples, CropConfig())
    network.eval()
    save_weights(file, replace(weights, calibration=fitted))
    return CalibrationStudy(fitted, others.scores(weights.calibration), others.scores(fitted))

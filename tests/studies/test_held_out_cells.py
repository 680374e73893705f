"""Held-out cells: the truth of a cell, its shadow share, and what was not measured."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import ConfigError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow.pillarflow.training.examples import LabelledPair, Labels
from mottrack.studies.held_out_cells import HeldOutCells, cells_table

GRID = BevGrid(-20.0, 20.0, -20.0, 20.0, 0.5)
ORIGIN_M = np.array([0.0, 0.0, 1.8])
CAR_MPS = (3.0, 0.0)


def _wall(azimuth_deg: tuple[float, float], range_m: float) -> np.ndarray:
    """A dense upright surface about the sensor, 0.5 to 2 m high."""
    turn, height = np.meshgrid(
        np.radians(np.arange(*azimuth_deg, 0.2)), np.arange(0.5, 2.0, 0.02), indexing="ij"
    )
    return np.stack([range_m * np.cos(turn), range_m * np.sin(turn), height], axis=-1)


def _sweep(stamp_ns: int, *surfaces: np.ndarray) -> Sweep:
    x, y = np.meshgrid(np.arange(-20, 20, 0.4), np.arange(-20, 20, 0.4))
    ground = np.stack([x, y, np.zeros_like(x)], axis=-1)
    xyz_m = np.concatenate([part.reshape(-1, 3) for part in (ground, *surfaces)])
    return Sweep(
        xyz_m.astype(np.float32),
        np.zeros(len(xyz_m), np.float32),
        stamp_ns,
        Pose.identity(),
        origin_m=ORIGIN_M,
    )


@pytest.fixture
def pair() -> LabelledPair:
    """Two walls at 12 m, of which one was hidden 0.2 s before, and a car opposite."""
    open_wall, covered, screen = (
        _wall((20, 50), 12.0),
        _wall((-50, -20), 12.0),
        _wall((-60, -10), 6),
    )
    car = _wall((170, 190), 9.0)
    before = _sweep(0, open_wall, screen, car - [0.6, 0, 0])
    newest = _sweep(100_000_000, open_wall, covered, car - [0.3, 0, 0])
    now = _sweep(200_000_000, open_wall, covered, car)
    moving = np.zeros((len(now), 2), np.float32)
    moving[-car.size // 3 :] = CAR_MPS
    none = np.zeros(0, np.int16)
    labels = Labels(none, none, moving, np.zeros((0, 3, 2), np.float32))
    return LabelledPair(newest, now, labels, (before,))


def _field(pair: LabelledPair, measured: np.ndarray | None = None) -> FlowField:
    """A source that says that everything rests, and nonsense where it has measured nothing."""
    occupied = GRID.occupancy(pair.current.xyz_m)
    valid = occupied if measured is None else occupied & measured
    velocity_mps = np.where(valid, 0.0, 99.0).astype(np.float32)[..., None].repeat(2, axis=2)
    covariance = np.zeros((*GRID.shape, 2, 2), np.float32)
    weight = occupied.astype(np.float32)
    return FlowField(GRID, velocity_mps, covariance, occupied, valid, weight, pair.current.stamp_ns)


def _rows(cells: HeldOutCells) -> dict[str, tuple[object, ...]]:
    return {str(row[0]): row[1:] for row in cells_table("it", cells).rows}


def test_cells_are_sorted_by_what_the_earlier_sweep_could_not_see(pair: LabelledPair) -> None:
    cells = HeldOutCells.of(pair, _field(pair))
    rows = _rows(cells)
    hidden, seen = rows["hidden 0.6 to 1"][0], rows["hidden 0"][0]
    assert hidden > 10
    assert seen > 10
    assert hidden + seen > 0.9 * rows["at rest"][0]
    assert rows["ego 0 to 0.5 m/s"][0] == rows["at rest"][0]
    assert rows["at rest"][1:] == (100.0, 0.0, 0.0)
    assert rows["moving"][1] == 100.0
    assert rows["moving"][2] == pytest.approx(3.0)
    assert rows["moving"][3] == 100.0


def test_what_was_not_measured_enters_no_error(pair: LabelledPair) -> None:
    """Nonsense in cells without a measurement changes no error; their share is printed."""
    left = GRID.centres_m()[..., 1] > 0
    rows = _rows(HeldOutCells.of(pair, _field(pair, left)))
    assert rows["hidden 0.6 to 1"][1:] == (0.0, None, None)
    assert rows["hidden 0"][2:] == (0.0, 0.0)
    assert 30 < rows["moving"][1] < 70
    assert rows["moving"][2] == pytest.approx(3.0)


def test_the_command_runs_any_source_and_refuses_what_has_no_effect() -> None:
    def run(*words: str) -> str:
        return CliRunner().invoke(app, ["validate-flow", *words], catch_exceptions=False).output

    text = run("flow=zero,pillarflow_raw", "grid.cell_m=0.5", "--pairs", "1")
    assert "zero: held-out pairs" in text
    assert "pillarflow_raw: held-out pairs" in text
    with pytest.raises(ConfigError, match=r"dataset\.seed has no effect"):
        run("dataset.seed=3")
    with pytest.raises(ConfigError, match="reads boxes"):
        run("flow=icp")

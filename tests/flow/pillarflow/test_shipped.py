"""The weights that come with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mottrack.flow.pillarflow.source import (
    SHIPPED,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.studies.training_examples import world_pair

FILES = sorted(SHIPPED.glob("*.safetensors"))


def test_the_documented_names_are_shipped() -> None:
    assert {"base", "small", "binary_ogm"} <= {file.stem for file in FILES}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_they_are_small_and_documented(file: Path) -> None:
    assert file.stat().st_size < 5_000_000
    card = file.with_suffix(".md").read_text()
    assert all(word in card for word in ("mottrack train", "seed", "hours", "RMSE"))


@pytest.mark.parametrize("make", [PillarFlow, BinaryOgmFlow])
def test_raw_network_beats_no_flow_on_a_held_out_pair(make: type[PillarFlow]) -> None:
    pair = world_pair(654_321, 0, {})
    source = make(make.Config(refined=False))
    field = source.estimate([pair.previous], pair.current)
    moving = np.linalg.norm(pair.labels.velocity_mps, axis=1) > 1.0
    rows, columns, inside = field.grid.cells(pair.current.xyz_m[moving])
    truth = pair.labels.velocity_mps[moving][inside]
    found = field.velocity_mps[rows, columns][inside]
    kept = field.occupied[rows, columns][inside]
    assert kept.sum() > 20
    error = np.linalg.norm(found - truth, axis=1)[kept]
    assert np.median(error) < 0.5 * np.median(np.linalg.norm(truth, axis=1)[kept])


def test_small_runs_too() -> None:
    source = PillarFlow(PillarFlowConfig(weights="small"))
    assert source.cells.rows == 216  # 100 m and the margin, in cells of 0.5 m

"""Tracks, truth and scores as data frames of other libraries."""

from __future__ import annotations

import builtins
import importlib

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

from mottrack import Tracks
from mottrack.core import MottrackError
from mottrack.core.frame import Frame
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.eval.evaluation import score


def tracks(stamp_ns: int, n: int = 3) -> Tracks:
    rng = np.random.default_rng(stamp_ns)
    return Tracks(
        stamp_ns=stamp_ns,
        centre_m=rng.normal(size=(n, 3)),
        size_m=np.ones((n, 3)),
        yaw_rad=rng.normal(size=n),
        label=np.array(["car"] * n),
        id=np.arange(n),
        score=np.ones(n),
        velocity_mps=rng.normal(size=(n, 2)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
        state=np.zeros((n, 4)),
        covariance=np.zeros((n, 4, 4)),
        observed=np.ones(n, np.bool_),
    )


def truth(source: Tracks) -> Truth:
    names = ("stamp_ns", "centre_m", "size_m", "yaw_rad", "label", "id", "velocity_mps")
    columns = {name: getattr(source, name) for name in names}
    n = len(source)
    return Truth(**columns, num_points=np.full(n, 5), interpolated=np.zeros(n, np.bool_))


@pytest.fixture
def result() -> SceneResult:
    steps = [tracks(stamp) for stamp in (1, 2, 3)]
    frames = [Frame(step.stamp_ns, Pose.identity(), truth=truth(step)) for step in steps]
    return SceneResult("a", FrameTable.of(frames), TruthTable.of(frames), TrackTable.of(steps))


def test_every_number_of_a_row_has_a_column_in_all_three_libraries(result):
    for table in (tracks(7), truth(tracks(7)), result.tracks, result.truth, result.frames):
        arrow, pandas, polars = table.to_arrow(), table.to_pandas(), table.to_polars()
        assert isinstance(arrow, pa.Table)
        assert isinstance(pandas, pd.DataFrame)
        assert isinstance(polars, pl.DataFrame)
        assert arrow.column_names == list(pandas.columns) == polars.columns
        assert len(arrow) == len(pandas) == len(polars) == len(table)
    frame = result.tracks.to_pandas()
    np.testing.assert_array_equal(frame[["x", "y", "z"]].to_numpy(), result.tracks.centre_m)
    np.testing.assert_array_equal(frame[["vx", "vy"]].to_numpy(), result.tracks.velocity_mps)
    assert frame["label"].tolist() == result.tracks.label.tolist()
    assert frame["observed"].dtype == np.bool_
    covariance = frame[["vxx", "vxy", "vyx", "vyy"]].to_numpy().reshape(-1, 2, 2)
    np.testing.assert_array_equal(covariance, result.tracks.velocity_covariance_m2ps2)


def test_an_empty_table_keeps_its_columns(result):
    assert result.tracks.select(np.zeros(0, np.int64)).to_polars().columns == (
        result.tracks.to_polars().columns
    )


def test_scores_are_a_row_for_each_figure(result):
    scores = score([result])
    frame = scores.to_pandas().set_index(["table", "row", "metric"])["value"]
    assert frame["tracking", "all", "mota"] == scores.overall.clear.mota == 1.0
    assert frame["velocity_error", "all", "count"] == scores.velocity["all"].count == 9
    assert len(scores.to_polars()) == len(frame)


def test_a_library_that_is_not_installed_is_told(monkeypatch, result):
    ordinary = builtins.__import__

    def refusing(name, *arguments, **keywords):
        if name == "polars":
            raise ImportError(name)
        return ordinary(name, *arguments, **keywords)

    monkeypatch.setattr(importlib, "import_module", lambda name: refusing(name, fromlist=[""]))
    with pytest.raises(MottrackError, match="polars is not installed: pip install polars"):
        result.tracks.to_polars()

"""What a flow source with several past sweeps receives in a run, from shared and stored flow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from mottrack.core import BevGrid, FlowField, FlowSourceBase, Frame, Pose, Sweep
from mottrack.core.sweep import seconds_between
from mottrack.experiment.experiment import load_to_stream
from mottrack.pipeline.flow_cache import CachedFlow, FlowCache
from mottrack.pipeline.once import SharedFlow
from mottrack.pipeline.stream import Perception, Pipeline


class Remembering(FlowSourceBase):
    """Notes the ages of the past sweeps that it is given."""

    past_sweeps = 3
    ages_s: ClassVar[list[list[float]]] = []

    def __init__(self, *, grid: BevGrid) -> None:
        self.grid = grid

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        self.ages_s.append([round(seconds_between(s.stamp_ns, current.stamp_ns), 3) for s in past])
        return FlowField.unmeasured(self.grid, np.zeros(self.grid.shape, bool), current.stamp_ns)


def stream(flow: object, history_s: float = 0.3) -> None:
    """Feed six sweeps at 10 Hz to two runs in lockstep."""
    chosen = ["flow=zero", "objects=clusters", f"history_s={history_s}"]
    experiment = load_to_stream("demo", chosen)
    pipelines = [
        Pipeline(experiment, parts=Perception(flow, experiment.objects.make()))  # type: ignore[arg-type]
        for _ in range(2)
    ]
    for index in range(6):
        stamp_ns = index * 10**8
        sweep = Sweep(np.zeros((1, 3)), np.zeros(1), stamp_ns, Pose.identity())
        for pipeline in pipelines:
            pipeline.step(Frame(stamp_ns, Pose.identity()), sweep)


@pytest.fixture
def source() -> Remembering:
    Remembering.ages_s.clear()
    return Remembering(grid=load_to_stream("demo", ["flow=zero"]).settings.grid.grid())


def test_runs_that_share_a_source_ask_it_once_for_a_sweep_with_its_past(
    source: Remembering,
) -> None:
    stream(SharedFlow(source))
    assert source.ages_s == [[0.1], [0.2, 0.1], *[[0.3, 0.2, 0.1]] * 3]


def test_a_stored_field_is_that_of_the_same_past(source: Remembering, tmp_path: Path) -> None:
    cache = FlowCache(tmp_path, 10**9)
    for history_s, measured in ((0.3, 5), (0.3, 5), (0.2, 10)):
        cached = CachedFlow(source, f"history {history_s}", cache)
        stream(SharedFlow(cached), history_s)
        cached.keep()
        assert len(source.ages_s) == measured

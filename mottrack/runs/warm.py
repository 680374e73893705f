"""Compile beforehand what the first run would compile: once for an installation."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mottrack.compiled import cache_place, compilation_told
from mottrack.eval.evaluation import score
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.geometry.polygon import convex_area
from mottrack.pipeline.scene_run import Member, run_together
from mottrack.runs.runner import scene_names

SHORT = ("dataset.scenes=1", "dataset.duration_s=1.5", "snapshots.scenes=0")
"""A scene with enough sweeps for every part to be called: the second key frame has flow."""
STEPS = {
    "the embedded world, clusters, the fixed-lag tracker": (
        "demo",
        ("objects=clusters", "tracker=fixed_lag", "flow=zero", "dataset.key_hz=5"),
    ),
    "the Kalman tracker, scores": ("demo", ("flow=zero,ground_truth",)),
    "ICP": ("demo", ("flow=icp",)),
    "cluster ICP": ("demo", ("flow=cluster_icp",)),
    "PillarFlow": ("demo", ("flow=pillarflow",)),
    "DOGMa": ("demo", ("flow=dogma",)),
}
"""What is compiled, and the experiment that calls it."""


class Warmed(NamedTuple):
    """One step that was run."""

    what: str
    functions: int
    """How many were compiled; 0 where all were kept from before."""
    cpu_s: float


def warm() -> Iterator[Warmed]:
    """Run each step of `STEPS`; yield what it has compiled."""
    compiled: list[None] = []
    for what, (config, overrides) in STEPS.items():
        before, begin_s = len(compiled), time.process_time()
        with compilation_told(lambda: compiled.append(None)):
            _run(load_experiments(config, [*SHORT, *overrides]))
        yield Warmed(what, len(compiled) - before, time.process_time() - begin_s)


def _run(experiments: list[Experiment]) -> None:
    scene = experiments[0].dataset.make().scene(scene_names(experiments[0])[0])
    runs = run_together([Member(e, keep_snapshots=False) for e in experiments], scene)
    for experiment, run in zip(experiments, runs, strict=True):
        if isinstance(run, Exception):
            raise run
        score([run.result], experiment.settings.scores)


def kept_in() -> Path | None:
    """Return the folder of one compiled function: the others' are beside it; None: nowhere."""
    return cache_place(convex_area)

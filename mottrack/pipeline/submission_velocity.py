"""Velocity error of a nuScenes submission, anybody's, by category (paper, section V-B)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.storage import write_text
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.eval.nuscenes.command import Request
from mottrack.eval.nuscenes.submission import read_submission
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, PairedDifference, draw, paired_all, sample
from mottrack.eval.run_metrics import velocity_metrics
from mottrack.eval.velocity_error import (
    VelocityErrorConfig,
    velocity_samples,
    velocity_table,
)
from mottrack.formats.nuscenes_classes import CLASSES
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import aligned
from mottrack.pipeline.result_files import submission_results

COLUMNS = ("mean", "median", "worst 5 %", "rows")


def velocity_report(request: Request, other: Path | None, out: Path) -> Iterator[str]:
    """Write `velocity_error.json` to a folder and yield the tables.

    A submission does not tell coasted boxes from observed ones, so all count. Boxes whose velocity
    is NaN are left out, with a line that says how many.

    Args:
        request: data set, split and submission; it was found valid before.
        other: a second submission, whose paired differences to the first are added; or None.
        out: folder.

    Raises:
        DataError: a table or a submission is not usable.
    """
    config = NuScenesConfig(
        root=request.dataroot, version=request.version, split=request.split, rate_hz=2
    )
    dataset = NuScenes(config)
    first = submission_results(dataset, read_submission(request.submission))
    if not any(len(result.truth) for result in first):
        yield "velocity error: this split has no annotations"
        return
    yield from _unknown(request.submission, first)
    samples = [velocity_samples(result) for result in first]
    table = velocity_table(samples, classes=CLASSES)
    content: dict[str, Any] = {"velocity_error": {n: asdict(row) for n, row in table.items()}}
    rows = [
        [name, *(_number(v) for v in (e.mean_mps, e.median_mps, e.worst_mean_mps)), str(e.count)]
        for name, e in table.items()
    ]
    yield f"velocity error of the tracks, m/s\n{aligned([['tracks', *COLUMNS], *rows])}"
    if other is not None:
        second = submission_results(dataset, read_submission(other))
        yield from _unknown(other, second)
        found = _differences(first, second)
        content["differences"] = [
            {"row": d.key.row, "metric": d.key.metric, **d.as_dict()} for d in found
        ]
        yield _comparison(found)
    write_text(out / "velocity_error.json", json.dumps(strict(content), indent=1))


def _unknown(path: Path, results: Sequence[SceneResult]) -> Iterator[str]:
    count = sum(int((~result.tracks.observed).sum()) for result in results)
    if count:
        yield f"{path.name}: {count} boxes have no velocity (NaN) and are left out"


def _differences(
    first: Sequence[SceneResult], second: Sequence[SceneResult]
) -> tuple[PairedDifference, ...]:
    weights = draw(len(first), RESAMPLES)
    config = VelocityErrorConfig()
    sides = ([velocity_samples(result) for result in side] for side in (first, second))
    sampled = [
        {key: sample(m, weights) for key, m in velocity_metrics(side, config, CLASSES, weights)}
        for side in sides
    ]
    return paired_all(sampled[0], sampled[1])


def _comparison(found: Sequence[PairedDifference]) -> str:
    rows = [
        [f"{d.key.row}, {d.key.metric}", _number(d.baseline), _number(d.value), _interval(d)]
        for d in found
    ]
    title = f"velocity error, difference to the first submission, {CONFIDENCE:.0%} intervals"
    head = ["tracks", "first", "second", "difference"]
    return f"{title}; *: significant\n{aligned([head, *rows])}"


def _interval(found: PairedDifference) -> str:
    if np.isnan(found.low):
        return f"{found.difference:+.3f} (one scene)"
    mark = "*" if found.significant else ""
    return f"{found.difference:+.3f} [{found.low:+.3f}, {found.high:+.3f}]{mark}"


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3f}"

"""Scene flow figures of the runs of a comparison: their stored sums, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

from mottrack.core.arrays import I64
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, MetricKey, Sampled, draw
from mottrack.eval.sceneflow.figures import COMPARED, SceneSums, key_of
from mottrack.eval.sceneflow.report import interval_text
from mottrack.eval.sceneflow.stored import empty_sums
from mottrack.eval.sceneflow.sums import SUMS
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.runs.scored_run import ScoredRun

NOTE = (
    "Points of the key frames; EPE in m per pair of sweeps, the dynamic error is a share of the "
    f"speed. In brackets {CONFIDENCE:.0%} intervals over scenes. As mottrack eval sceneflow, but "
    "of the motion since the sweep before: a run knows no later one"
)


def scene_sums(run: ScoredRun, scenes: Sequence[str]) -> SceneSums | None:
    """Return the stored sums of some finished scenes; None where none of them has any.

    Raises:
        ResultError: a file is damaged.
    """
    found = [run.folder.load_scene_flow(scene) for scene in scenes]
    if all(part is None for part in found):
        return None
    return SceneSums(tuple(empty_sums() if part is None else part for part in found))


def scene_flow_metrics(
    run: ScoredRun, scenes: Sequence[str], weights: I64
) -> dict[MetricKey, Sampled]:
    """Return the figures that runs are compared by on every resample (B, S) of the scenes."""
    sums = scene_sums(run, scenes)
    if sums is None:
        return {}
    sampled = sums.sampled(weights)
    return {key: sampled[key] for key in map(_key, COMPARED) if key in sampled}


def scene_flow_tables(runs: Sequence[ScoredRun]) -> list[TextTable]:
    """Tabulate the compared figures with intervals, then EPE, accuracy and angle by row."""
    sums = {run.title: scene_sums(run, run.finished) for run in runs}
    known = {title: part for title, part in sums.items() if part is not None}
    return [_headline(known), _rows(known)] if known else []


def _headline(runs: dict[str, SceneSums]) -> TextTable:
    rows: list[tuple[Cell, ...]] = []
    sampled = {
        title: sums.sampled(draw(len(sums.scenes), RESAMPLES)) for title, sums in runs.items()
    }
    for place in COMPARED:
        found = [figures.get(_key(place)) for figures in sampled.values()]
        rows.append((_key(place).title, *map(interval_text, found)))
    columns = (Column("figure"), *(Column(title) for title in runs))
    return TextTable("sceneflow", "Scene flow", columns, tuple(rows), NOTE)


def _rows(runs: dict[str, SceneSums]) -> TextTable:
    names = ("strict", "relaxed", "angle [rad]", "EPE [m]")
    columns = [Column("run"), Column("points of"), Column("points")]
    rows: list[tuple[Cell, ...]] = []
    for title, sums in runs.items():
        values = sums.values()
        for row, counted in sums.whole.rows.items():
            numbers = (values[row, name] for name in SUMS[1:])
            rows.append((title, row, int(counted[0]), *numbers))
    columns += [Column(name, 4) for name in names]
    title = "Scene flow by range, speed and class"
    return TextTable("sceneflow_rows", title, tuple(columns), tuple(rows), NOTE)


def _key(place: tuple[str, str]) -> MetricKey:
    return key_of(*place)

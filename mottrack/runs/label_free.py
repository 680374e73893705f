"""Label-free figures of the runs of a comparison: their stored sums, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

from mottrack.core.arrays import I64
from mottrack.eval.label_free import COMPARED, KEYS, LabelFreeSums, SceneJudgements
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, MetricKey, Sampled, draw
from mottrack.eval.sceneflow.report import interval_text
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.runs.scored_run import ScoredRun

NOTE = (
    "Judged by geometry, without labels: an earlier sweep decides which objects moved and which "
    "rested. Error and residuals estimate the RMSE of the flow; no flow has the largest error of "
    "what moves and none of what rests: rank by the error of all. In brackets "
    f"{CONFIDENCE:.0%} intervals over scenes"
)


def judgements(run: ScoredRun, scenes: Sequence[str]) -> SceneJudgements | None:
    """Return the stored sums of some finished scenes; None where none of them has any.

    Raises:
        ResultError: a file is damaged.
    """
    found = [run.folder.load_label_free(scene) for scene in scenes]
    if all(part is None for part in found):
        return None
    return SceneJudgements(tuple(LabelFreeSums() if part is None else part for part in found))


def label_free_metrics(
    run: ScoredRun, scenes: Sequence[str], weights: I64
) -> dict[MetricKey, Sampled]:
    """Return the figures that runs are compared by on every resample (B, S) of the scenes."""
    found = judgements(run, scenes)
    sampled = {} if found is None else found.sampled(weights)
    return {key: sampled[key] for key in COMPARED if key in sampled}


def label_free_table(runs: Sequence[ScoredRun]) -> TextTable | None:
    """Tabulate the figures of every run with intervals; None where no flow was judged."""
    found = {run.title: judgements(run, run.finished) for run in runs}
    sampled = {
        title: part.sampled(draw(len(part.scenes), RESAMPLES))
        for title, part in found.items()
        if part is not None
    }
    if not sampled:
        return None
    rows: list[tuple[Cell, ...]] = []
    for key in KEYS:
        figures = [figures.get(key) for figures in sampled.values()]
        if any(figure is not None for figure in figures):
            rows.append((key.title, *map(interval_text, figures)))
    columns = (Column("figure"), *(Column(title) for title in sampled))
    return TextTable("label_free", "Flow without labels", columns, tuple(rows), NOTE)

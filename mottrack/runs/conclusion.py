"""What a comparison has found, in one sentence, and whether it is significant."""

from __future__ import annotations

from collections.abc import Sequence

from mottrack.eval.label_free import ERROR
from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.runs.comparison import Comparison
from mottrack.runs.differences import RunDifferences
from mottrack.runs.scored_run import ScoredRun

VELOCITY = MetricKey("velocity", "all", "mean")
AMOTA = MetricKey("tracking", "all", "AMOTA")
MOTA = MetricKey("tracking", "all", "MOTA")
FLOW = MetricKey("flow", "dynamic", "RMSE")
NAMES = {
    VELOCITY: "velocity error",
    AMOTA: "AMOTA",
    MOTA: "MOTA",
    FLOW: "flow RMSE of moving cells",
    ERROR: "flow error without labels",
}
"""Metrics that are told, in order of what they say of the whole pipeline."""
UNITS = {VELOCITY: " m/s", FLOW: " m/s", ERROR: " m/s"}


def conclusion(comparison: Comparison) -> str:
    """Return one sentence about the runs of a comparison.

    The run that is told of is the one with the least velocity error (else the best AMOTA or MOTA)
    among those that are significantly better than their baseline, or among all if none is. A run
    that was given the truth is never told of.
    """
    runs = [run for run in comparison.runs if run.finished]
    if not runs:
        return "No scene was finished, so nothing is known."
    measured = {run.title for run in runs if not run.given_truth}
    parts = [part for part in comparison.differences if part.run in measured]
    if not any(run.has_truth for run in runs):
        judged = any(_row(part, ERROR) for part in parts)
        told = _told(parts, ERROR) if judged else "tracked, not scored."
        return f"{_scenes(runs)} without truth: {told}"
    if not parts:
        others = "all others were given the truth" if runs[1:] else "one run alone compares nothing"
        return f"{_alone(runs[0])}; {others}."
    key = next((k for k in NAMES if any(_row(part, k) for part in parts)), None)
    if key is None:
        return f"{_scenes(runs)}: no metric that all runs have."
    return _told(parts, key)


def _told(parts: Sequence[RunDifferences], key: MetricKey) -> str:
    rows = {part.run: row for part in parts if (row := _row(part, key)) is not None}
    gain = {run: row.difference * (1 if key.lower_is_better else -1) for run, row in rows.items()}
    better = [run for run in rows if rows[run].better]
    best = min(better or rows, key=lambda run: gain[run])
    part = next(part for part in parts if part.run == best)
    first = f"{best} against {part.baseline}: {_words(rows[best], key)}"
    others = [k for k in (AMOTA, MOTA) if k != key and _row(part, k) is not None][:1]
    flow = _row(part, FLOW)
    if not better and flow is not None and flow.better is not None:
        others = [FLOW, *others]  # the field is better, though its use is not shown
    told = [first, *(_words(row, k) for k in others if (row := _row(part, k)) is not None)]
    return f"{'; '.join(told)} ({part.scenes} scene{'' if part.scenes == 1 else 's'})."


def _words(row: PairedDifference, key: MetricKey) -> str:
    change = f"{NAMES[key]} {row.baseline:.3f} -> {row.value:.3f}{UNITS.get(key, '')}"
    if row.low != row.low:
        return f"{change}, of unknown significance"
    if row.better is None:
        return f"{change}, not significant"
    return f"{change}, significantly {'better' if row.better else 'worse'}"


def _alone(run: ScoredRun) -> str:
    figures = run.scores.overall
    error = run.velocity_error("all").mean_mps
    parts = [f"{NAMES[AMOTA]} {figures.amota:.3f}"] if figures.amota == figures.amota else []
    parts.append(f"MOTA {figures.as_dict()['mota']:.3f}")
    parts += [f"velocity error {error:.3f} m/s"] if error == error else []
    return f"{run.title}, {_scenes([run])}: {', '.join(parts)}"


def _row(part: RunDifferences, key: MetricKey) -> PairedDifference | None:
    found = next((row for row in part.rows if row.key == key), None)
    return found if found is not None and found.difference == found.difference else None


def _scenes(runs: Sequence[ScoredRun]) -> str:
    count = len({scene for run in runs for scene in run.finished})
    return f"{count} scene{'' if count == 1 else 's'}"

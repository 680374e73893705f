"""Runs of several trackers under every damage, and their figures along its amount."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.interfaces import Scene
from mottrack.core.storage import write_text
from mottrack.eval.evaluation import score
from mottrack.eval.scores import Scores
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables
from mottrack.pipeline.scene_run import run_scene
from mottrack.studies.stress.damage import DAMAGES
from mottrack.studies.stress.stressed import Stress, StressedFlow, StressedScene

FIGURES = ("amota", "mota", "idf1", "hota", "recall", "id_switches", "false_positives")
VELOCITY = "velocity_error_mps"
SHOWN = ("hota", "idf1", VELOCITY)
"""Figures that are drawn and printed; the file holds all."""
BROKEN_SHARE = 0.5
"""A tracker breaks where a figure that is better when higher has lost half of what it was."""

UNDAMAGED = Stress("", 0.0)


@dataclass(frozen=True)
class StressedPart(Part):
    """A flow source that is made with its damage."""

    stress: Stress = UNDAMAGED

    def make(self, **shared: Any) -> StressedFlow:
        """Return a new source."""
        return StressedFlow(Part.make(self, **shared), self.stress)


@dataclass(frozen=True)
class Outcome:
    """Figures of one tracker under one damage."""

    tracker: str
    stress: Stress
    figures: dict[str, float]


def outcomes(
    experiments: Sequence[Experiment], kinds: Sequence[str], tell: Callable[[str], None]
) -> Iterator[Outcome]:
    """Yield the figures of every tracker for every kind of damage and amount.

    Args:
        experiments: one for each tracker.
        kinds: of `DAMAGES`.
        tell: is told what runs.

    Raises:
        MottrackError: the data are damaged, or a part refuses its input.
    """
    for experiment in experiments:
        dataset = experiment.dataset.make()
        names = experiment.settings.scenes or dataset.scene_names
        scenes = [dataset.scene(name) for name in names]
        clean = _figures(experiment, scenes, UNDAMAGED)
        for kind in kinds:
            tell(f"{experiment.title}: {DAMAGES[kind].title.lower()}")
            for amount in DAMAGES[kind].steps:
                stress = Stress(kind, amount)
                found = _figures(experiment, scenes, stress) if amount else clean
                yield Outcome(experiment.title, stress, found)


def _figures(experiment: Experiment, scenes: Sequence[Scene], stress: Stress) -> dict[str, float]:
    settings = experiment.settings.model_copy(update={"score_flow": False})
    flow = experiment.flow
    part = StressedPart(flow.kind, flow.cls, flow.config, stress)
    stressed = replace(experiment, settings=settings, flow=part)
    runs = [
        run_scene(stressed, StressedScene(scene, stress), keep_snapshots=False) for scene in scenes
    ]
    return _of_scores(score([run.result for run in runs], settings.scores))


def _of_scores(scores: Scores) -> dict[str, float]:
    overall = scores.overall.as_dict()
    figures = {name: float(overall[name]) for name in FIGURES}
    return figures | {VELOCITY: scores.velocity["all"].mean_mps}


def breaking_amount(found: Sequence[Outcome], figure: str) -> float | None:
    """Return the first amount at which a figure has lost half of what it is undamaged.

    Args:
        found: of one tracker and kind, the undamaged one first.
        figure: better when higher.

    Returns:
        None where it never has.
    """
    whole = found[0].figures[figure]
    broken = (o.stress.amount for o in found if o.figures[figure] < BROKEN_SHARE * whole)
    return next(broken, None)


def write_outputs(folder: Path, found: Sequence[Outcome]) -> list[TextTable]:
    """Write `stress.json`, a table for each kind of damage and `stress.png`; return the tables."""
    rows = [
        {"tracker": o.tracker, "kind": o.stress.kind, "amount": o.stress.amount, **o.figures}
        for o in found
    ]
    write_text(folder / "stress.json", json.dumps(strict(rows), indent=1, allow_nan=False))
    kinds = list(dict.fromkeys(o.stress.kind for o in found))
    tables = [_table(kind, [o for o in found if o.stress.kind == kind]) for kind in kinds]
    write_tables(tables, folder / "tables")
    draw(folder / "stress.png", found)
    return tables


def _by_tracker(found: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    names = dict.fromkeys(o.tracker for o in found)
    return {name: [o for o in found if o.tracker == name] for name in names}


def _table(kind: str, found: Sequence[Outcome]) -> TextTable:
    """Return a line per tracker and amount, and where each tracker breaks."""
    damage = DAMAGES[kind]
    columns = [Column("tracker", 2), Column(damage.unit, 2), *(Column(n) for n in SHOWN)]
    rows: list[tuple[Cell, ...]] = [
        (o.tracker, o.stress.amount, *(o.figures[name] for name in SHOWN)) for o in found
    ]
    breaks = [
        f"{name} from {at:g}" if (at := breaking_amount(own, "hota")) is not None else f"{name} not"
        for name, own in _by_tracker(found).items()
    ]
    note = f"Breaks (HOTA halved): {'; '.join(breaks)}."
    return TextTable(f"stress_{kind}", damage.title, tuple(columns), tuple(rows), note)


def draw(path: Path, found: Sequence[Outcome]) -> None:
    """Draw every shown figure along the amount, a row of panels for each kind of damage."""
    from matplotlib.figure import Figure  # slow to import

    kinds = list(dict.fromkeys(o.stress.kind for o in found))
    figure = Figure(figsize=(4.6 * len(SHOWN), 2.7 * len(kinds)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(kinds), len(SHOWN)))
    for row, kind in zip(axes, kinds, strict=True):
        of_kind = _by_tracker([o for o in found if o.stress.kind == kind])
        for axis, name in zip(row, SHOWN, strict=True):
            for tracker, own in of_kind.items():
                amounts = [o.stress.amount for o in own]
                axis.plot(amounts, [o.figures[name] for o in own], "o-", ms=3, label=tracker)
            axis.set_xlabel(f"{DAMAGES[kind].title} [{DAMAGES[kind].unit}]")
            axis.set_ylabel(name)
            axis.set_ylim(bottom=0)
            axis.grid(alpha=0.3)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4) or 1)
    figure.savefig(path, dpi=100)

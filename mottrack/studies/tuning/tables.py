"""The outcome of a search as tables, and the tuned tracker as a file."""

from __future__ import annotations

import json

import yaml

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError
from mottrack.eval.paired import CONFIDENCE, PairedDifference
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.studies.tuning.search import Search, Tuned
from mottrack.studies.tuning.search_space import changed

VERDICTS = {True: "better", False: "worse", None: "not significant"}


def gain_table(tuned: Tuned) -> TextTable:
    """Tabulate default against tuned on scenes that took no part."""
    rows = tuple(_row(row) for row in tuned.held_out)
    columns = (
        Column("figure"),
        Column("default"),
        Column("tuned"),
        *(Column(name, signed=True) for name in ("difference", "low", "high")),
        Column("verdict"),
    )
    note = (
        f"Each scene is judged with settings found without its fold. {CONFIDENCE:.0%} intervals by "
        f"the jackknife over {tuned.held_out[0].scenes} scenes. The first line was sought."
    )
    return TextTable("held_out", "Default against tuned, held-out folds", columns, rows, note)


def _row(row: PairedDifference) -> tuple[Cell, ...]:
    name = f"{row.key.metric} {row.key.unit}".strip()
    numbers = (row.baseline, row.value, row.difference, row.low, row.high)
    return (name, *numbers, VERDICTS[row.better])


def found_table(search: Search, tuned: Tuned) -> TextTable:
    """Tabulate the values that each search found, and its figure on the fold left out."""
    rows: list[tuple[Cell, ...]] = []
    for setting in search.settings:
        found = [fold.values[setting.path] for fold in tuned.by_fold]
        rows.append(
            (setting.described(), *map(_text, (setting.current, *found, tuned.best[setting.path])))
        )
    figures = [f"{fold.default:.3f} -> {fold.tuned:.3f}" for fold in tuned.by_fold]
    rows.append((f"{search.objective.name} on the fold left out", "", *figures, ""))
    folds = (f"without fold {k}" for k in range(len(tuned.by_fold)))
    columns = tuple(Column(name) for name in ("setting", "default", *folds, "all scenes"))
    note = "Values that differ between folds by as much as their range are not determined."
    return TextTable("found", "Settings that were found", columns, tuple(rows), note)


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def tracker_yaml(search: Search, tuned: Tuned) -> str:
    """Return the tuned tracker as a group file, with what it gained in comments.

    Raises:
        ConfigError: the tracker declares no settings.
    """
    config = search.experiment.tracker.config
    if not isinstance(config, StrictModel):
        raise ConfigError(f"tracker '{search.experiment.tracker.kind}' declares no settings")
    gain = tuned.held_out[0]
    lines = (
        f"# {gain.key.metric} on held-out folds: default {gain.baseline:.4f}, tuned "
        f"{gain.value:.4f}, difference {gain.difference:+.4f} [{gain.low:+.4f}, {gain.high:+.4f}]",
        f"# {search.trials} trials, seed {search.seed}, {gain.scenes} scenes",
    )
    kind = {"kind": search.experiment.tracker.kind}
    settings = json.loads(json.dumps({**kind, **changed(config, tuned.best)}))
    body = yaml.safe_dump(settings, sort_keys=False, default_flow_style=None)
    return "\n".join(lines) + "\n" + body

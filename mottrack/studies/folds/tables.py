"""The outcome of a study on folds as tables."""

from __future__ import annotations

from collections.abc import Sequence

from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.studies.detector_model import rate_table
from mottrack.studies.folds.detector import DetectorRow
from mottrack.studies.folds.judges import Figures
from mottrack.studies.folds.plan import Plan
from mottrack.studies.folds.study import CHOSEN, Outcome, Row, mean_over_classes

ALL = "all (mean)"
"""In place of a class: the mean over classes, of switches the sum."""


def tables_of(plan: Plan, outcome: Outcome) -> list[TextTable]:
    """Return figures by group, class and tracker; with a choice, what was chosen and transfers."""
    found = [_figures(plan, outcome)]
    if outcome.chosen:
        found.append(_choices(plan, outcome))
    if outcome.transfers:
        found.append(_transfers(plan, outcome))
    if outcome.detector:
        counted = {f"{row.group}: {row.label}": row.counted for row in outcome.detector}
        found += [detector_table(outcome.detector), rate_table(counted)]
    if outcome.consistency:
        found.append(_consistency(outcome))
    return found


def _figures(plan: Plan, outcome: Outcome) -> TextTable:
    rows: list[tuple[Cell, ...]] = []
    for group in plan.groups:
        own = [row for row in outcome.rows if row.group == group.name]
        labels = list(dict.fromkeys(label for row in own for label in row.classes))
        rows += [_line(row, ALL, mean_over_classes(row.classes)) for row in own]
        for label in sorted(labels):
            shown = (row for row in own if row.folds and label in row.classes)
            rows += [_line(row, label, row.classes[label]) for row in shown]
    columns = (
        *(Column(name) for name in ("group", "class", "tracker")),
        *(Column(name) for name in ("AMOTA", "sAMOTA", "MOTA", "HOTA")),
        Column("IDS", 0),
        *(Column(name) for name in ("fold min", "fold max")),
    )
    note = (
        f"Fold min and max: AMOTA (of kitti's rules sAMOTA) on the scenes of each of "
        f"{plan.folds} folds alone. MOTA, HOTA and IDS at the score of the best MOTA."
    )
    if outcome.chosen:
        note += f' "{CHOSEN}": every scene took no part in choosing its settings.'
    return TextTable("folds", "Figures by group and class", columns, tuple(rows), note)


def _line(row: Row, label: str, figures: Figures) -> tuple[Cell, ...]:
    spread: Sequence[Cell] = (None, None)
    if label in row.classes:
        spread = row.spread(label, "amota")
    return (row.group, label, row.tracker, *figures, *spread)


def _choices(plan: Plan, outcome: Outcome) -> TextTable:
    scenes = plan.fold_of
    rows = tuple(
        (k, variant, " ".join(name for name, fold in scenes.items() if fold == k))
        for k, variant in enumerate(outcome.chosen)
    )
    columns = (Column("fold"), Column("chosen without it"), Column("scenes of the fold"))
    note = f"By the mean over groups and classes of {' and '.join(plan.objective)}."
    return TextTable("chosen", "Settings chosen on the other folds", columns, rows, note)


def _transfers(plan: Plan, outcome: Outcome) -> TextTable:
    rows = tuple(
        (t.chosen_on, t.judged_on, t.variant, t.figure, t.best, t.best - t.figure)
        for t in outcome.transfers
    )
    columns = (
        *(Column(name) for name in ("chosen on", "judged on", "variant", "figure", "best")),
        Column("loss", 4),
    )
    note = (
        f"Figure: mean over classes of {' and '.join(plan.objective)}. "
        "A scene of both groups counts on one side alone."
    )
    return TextTable("transfer", "Settings of one group, judged on another", columns, rows, note)


def detector_table(found: Sequence[DetectorRow]) -> TextTable:
    """Tabulate estimates of the other folds against counts."""
    rows = tuple(
        (
            row.group,
            row.label,
            row.counted.all.boxes,
            row.counted.after_detection.share,
            row.p_estimated,
            1e3 * row.counted.clutter_per_m2,
            1e3 * row.clutter_estimated,
            row.loss_constant,
            row.loss_calibrated,
        )
        for row in found
    )
    columns = (
        *(Column(name) for name in ("group", "class", "boxes")),
        Column("P_D counted"),
        Column("P_D of the other folds"),
        *(Column(f"clutter per 1000 m2, {name}", 2) for name in ("counted", "on line")),
        *(Column(f"log loss, {name}") for name in ("share alone", "calibrated score")),
    )
    note = (
        "P_D: of objects that were detected in the frame before. Clutter counted: detections that "
        "match no true box or one for the first time; on line: those that no track took, by the "
        "tracker itself, false tracks taking the later detections of theirs."
    )
    title = "Detector model, estimated on other scenes and counted"
    return TextTable("detector", title, columns, rows, note)


def _consistency(outcome: Outcome) -> TextTable:
    rows = tuple(
        (
            row.group,
            row.label,
            row.noise,
            row.position.count,
            *(row.position.mean_ratio, row.position.inside_95),
            *(row.state.mean_ratio, row.state.inside_95),
            *(row.velocity.mean_ratio, row.velocity.inside_95),
        )
        for row in outcome.consistency
    )
    columns = (
        *(Column(name) for name in ("group", "class", "noise", "innovations")),
        *(
            Column(f"{what}: {name}")
            for what in ("NIS of x, y", "NEES of x, y, d_x, d_y", "NEES of the velocity")
            for name in ("mean ratio", "inside 95 %")
        ),
    )
    note = (
        "Of detections and tracks that match a true box. A consistent filter has a ratio of 1 and "
        "a share of .95 below the 95 % quantile."
    )
    return TextTable("consistency", "Consistency on folds left out", columns, rows, note)

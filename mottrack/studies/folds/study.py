"""Track every scene with every variant, choose on other folds, judge on the one left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.errors import ConfigError
from mottrack.core.result import SceneResult
from mottrack.studies.folds.detector import (
    ConsistencyRow,
    DetectorRow,
    consistency_rows,
    detector_rows,
    folds_of,
    kalman_config,
)
from mottrack.studies.folds.groups import RecordedGroup, record_group
from mottrack.studies.folds.judges import NOT_DEFINED, ByClass, Figures, Judge, mean_figure
from mottrack.studies.folds.plan import Plan

CHOSEN = "chosen on the other folds"
"""The row of scenes each tracked with the settings that the folds without it chose."""
OnStep = Callable[[str], None]


class Row(NamedTuple):
    """Figures of one tracker on one group."""

    group: str
    tracker: str
    classes: ByClass
    folds: tuple[ByClass, ...]
    """The same on the scenes of each fold alone; empty where the mean alone is shown."""

    def spread(self, label: str, name: str) -> tuple[float, float]:
        """Return the lowest and highest value of a figure over the folds that have the class."""
        found = [one[label].value(name) for one in self.folds if label in one]
        values = [value for value in found if np.isfinite(value)]
        return (min(values), max(values)) if values else (NOT_DEFINED, NOT_DEFINED)


class Transfer(NamedTuple):
    """Settings chosen on one group alone, judged on another."""

    chosen_on: str
    judged_on: str
    variant: str
    figure: float
    best: float
    """Of the variant that is best there."""


@dataclass(frozen=True)
class Outcome:
    """What a study on folds found."""

    rows: tuple[Row, ...]
    chosen: tuple[str, ...]
    """The variant that each fold's other folds chose; empty if there was no choice."""
    transfers: tuple[Transfer, ...]
    detector: tuple[DetectorRow, ...]
    consistency: tuple[ConsistencyRow, ...]


def study(plan: Plan, data: Path, on_step: OnStep) -> Outcome:
    """Run the study.

    Args:
        plan: groups, variants, folds.
        data: folder below which roots and stored tracks of the groups lie.
        on_step: receives a line after each piece of work.

    Raises:
        ConfigError: a setting is wrong.
        DataError: data or stored tracks are damaged or absent.
    """
    trackers = plan.trackers
    _require_files(plan, data)
    groups = tuple(record_group(one, data, on_step) for one in plan.groups)
    work = _Work(plan, groups)
    for name, tracker in trackers.items():
        work.add(name, [group.tracked(tracker) for group in groups])
        on_step(f"variant {name}")
    rows = [work.row(g, name, judge) for (g, name), judge in work.judges.items()]
    chosen = tuple(work.choose(fold) for fold in range(plan.folds)) if plan.choose else ()
    if chosen:
        rows += [work.row(g, CHOSEN, work.chosen_judge(g, chosen)) for g in range(len(groups))]
        on_step("choice on folds")
    for g, recorded in enumerate(groups):
        for name in recorded.group.tracks:
            rows.append(work.row(g, name, recorded.stored(name, data)))
            on_step(f"stored tracks {name}")
    order = {group.name: k for k, group in enumerate(plan.groups)}
    ordered = tuple(sorted(rows, key=lambda row: order[row.group]))
    transfers = tuple(work.transfers()) if chosen else ()
    detector: list[DetectorRow] = []
    consistency: list[ConsistencyRow] = []
    if plan.detector:
        config = kalman_config(trackers[plan.reference])
        for recorded in groups:
            folds = list(folds_of(recorded, plan.fold_of))
            detector += detector_rows(recorded, folds, config)
            consistency += consistency_rows(recorded, folds, config)
            on_step(f"detector of {recorded.group.name}")
    return Outcome(ordered, chosen, transfers, tuple(detector), tuple(consistency))


def _require_files(plan: Plan, data: Path) -> None:
    """Refuse settings and missing stored tracks before minutes of work.

    Raises:
        ConfigError: a setting is wrong.
        DataError: a file is missing.
    """
    for group in plan.groups:
        group.experiments(data)
        for name in group.tracks:
            group.stored(name, data)


class _Work:
    """Results and judges of every variant on every group."""

    def __init__(self, plan: Plan, groups: Sequence[RecordedGroup]) -> None:
        self.plan, self.groups, self.fold_of = plan, groups, plan.fold_of
        self.results: dict[tuple[int, str], list[SceneResult]] = {}
        self.judges: dict[tuple[int, str], Judge] = {}

    def add(self, variant: str, results: Sequence[list[SceneResult]]) -> None:
        """Keep the results of a variant, one list for each group."""
        for g, own in enumerate(results):
            self.results[g, variant] = own
            self.judges[g, variant] = self.groups[g].judge(own)

    def scenes(self, g: int, fold: int, *, inside: bool) -> list[str]:
        """Return the scenes of a group in a fold, or those outside of it."""
        return [s for s in self.groups[g].names if (self.fold_of[s] == fold) == inside]

    def row(self, g: int, tracker: str, judge: Judge) -> Row:
        """Return the figures of all scenes of a group, and of each fold's if they are shown."""
        name, whole = self.groups[g].group.name, self.groups[g].names
        if tracker in self.plan.choose and tracker != self.plan.reference:
            return Row(name, tracker, judge.figures(whole, hota=self._wants_hota), ())
        parts = [self.scenes(g, fold, inside=True) for fold in range(self.plan.folds)]
        by_fold = tuple(judge.figures(part, hota=False) for part in parts if part)
        return Row(name, tracker, judge.figures(whole), by_fold)

    @property
    def _wants_hota(self) -> bool:
        return "hota" in self.plan.objective

    def choose(self, fold: int) -> str:
        """Return the best variant on the scenes outside of a fold."""
        parts = {g: self.scenes(g, fold, inside=False) for g in range(len(self.groups))}
        return self._best({g: names for g, names in parts.items() if names})

    def _best(self, parts: dict[int, list[str]]) -> str:
        """Return the variant with the highest objective over scenes by group; the first of equals.

        Raises:
            ConfigError: no variant has a figure on them.
        """
        figures = {
            variant: np.mean([self._objective(g, variant, names) for g, names in parts.items()])
            for variant in self.plan.choose
        }
        known = {variant: value for variant, value in figures.items() if np.isfinite(value)}
        if not known:
            names = ", ".join(name for part in parts.values() for name in part)
            raise ConfigError(f"no variant has {'/'.join(self.plan.objective)} on scenes {names}")
        return max(known, key=lambda variant: known[variant])

    def _objective(self, g: int, variant: str, names: Sequence[str]) -> float:
        found = self.judges[g, variant].figures(names, hota=self._wants_hota)
        return float(np.mean([mean_figure(found, name) for name in self.plan.objective]))

    def chosen_judge(self, g: int, chosen: Sequence[str]) -> Judge:
        """Return the judge of scenes each tracked with the variant chosen without its fold."""
        group = self.groups[g]
        picked = [
            self.results[g, chosen[self.fold_of[name]]][k] for k, name in enumerate(group.names)
        ]
        return group.judge(picked)

    def transfers(self) -> list[Transfer]:
        """Return for each pair of groups what a choice on one is worth on the other.

        A scene of both groups, whose truth is the same, is left out on one side: where the settings
        are judged, or, if nothing is left there, where they are chosen.
        """
        found = []
        for a, first in enumerate(self.groups):
            for b, second in enumerate(self.groups):
                chosen_on, judged_on = _apart(first.names, second.names)
                if a != b and chosen_on and judged_on:
                    variant = self._best({a: chosen_on})
                    figures = {v: self._objective(b, v, judged_on) for v in self.plan.choose}
                    names = first.group.name, second.group.name
                    best = max(figures.values())
                    found.append(Transfer(*names, variant, figures[variant], best))
        return found


class _Apart(NamedTuple):
    chosen_on: list[str]
    judged_on: list[str]


def _apart(first: Sequence[str], second: Sequence[str]) -> _Apart:
    """Return the scenes of two groups without those of both on one side."""
    rest = [name for name in second if name not in first]
    if rest:
        return _Apart(list(first), rest)
    return _Apart([name for name in first if name not in second], list(second))


def mean_over_classes(found: ByClass) -> Figures:
    """Return the mean of each figure over the classes, and the sum of switches."""
    means = {
        name: float(np.mean([getattr(one, name) for one in found.values()])) if found else np.nan
        for name in ("amota", "samota", "mota", "hota")
    }
    return Figures(**means, switches=sum(one.switches for one in found.values()))

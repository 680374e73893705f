"""Scores of many scenes, of which one at a time is held.

AMOTA needs the classes of all scenes before the first is matched, the least score of a class needs
AMOTA's recall levels, and a median needs the number of values. So the scenes are read several
times, and of each only counts are kept: some kilobytes, whatever its length. The errors of the
velocities lie in a temporary file meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.tables import FlowSamples
from mottrack.eval import clear
from mottrack.eval.flow_error import FlowTable
from mottrack.eval.nuscenes.boxes import Prepared
from mottrack.eval.nuscenes.error_counts import ClassErrors, classify_errors
from mottrack.eval.nuscenes.metrics import Metrics
from mottrack.eval.nuscenes.prepare import prepare_scenes, rules_for
from mottrack.eval.nuscenes.resampling import Profile, evaluate_profiles, profiles
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.sample_file import SampleFile
from mottrack.eval.scores import (
    ClassScores,
    ScoreConfig,
    ScoreFilter,
    Scores,
    best_threshold,
    scene_scores,
    scored_part,
    together,
)
from mottrack.eval.velocity_error import velocity_samples, velocity_table

BATCH = 16
"""Scenes whose boxes are prepared together: numpy's time for a call is then small against that for
the boxes, and 16 scenes are some megabytes."""


def score(results: Sequence[SceneResult], config: ScoreConfig | None = None) -> Scores:
    """Return the scores of the scenes together.

    Truth counts from the first to the last frame in which its object has a LiDAR return. Where no
    track carries a class of the truth (clusters), the evaluation is class-agnostic.
    """
    return Evaluation(results, config or ScoreConfig()).scores


class SceneLabels(NamedTuple):
    """The classes of a scene."""

    declared: frozenset[str]
    """By the data set."""
    found: frozenset[str]
    """In truth or tracks."""
    aware: bool
    """Whether a track carries a class of the truth."""


def class_aware(scenes: Iterable[SceneLabels]) -> bool:
    """Return whether any track carries a class of the truth."""
    return any(scene.aware for scene in scenes)


def counted_labels(scenes: Sequence[SceneLabels]) -> list[str]:
    """Return the classes that count: those of the data set, else those in truth or tracks."""
    declared = frozenset[str]().union(*(scene.declared for scene in scenes))
    found = frozenset[str]().union(*(scene.found for scene in scenes))
    return sorted(declared & found if declared else found)


class Pooled(NamedTuple):
    """Scores of all boxes, whatever their class."""

    together: ClassScores
    scenes: list[clear.ClearCounts]


class Evaluation:
    """The metrics of scenes; each is computed once, when first asked for."""

    def __init__(
        self,
        results: Sequence[SceneResult],
        config: ScoreConfig,
        boxes: Sequence[SceneResult] | None = None,
    ) -> None:
        """Take the scenes.

        Args:
            results: read in order, several times; they may be loaded anew each time.
            config: how boxes are matched.
            boxes: the same without the samples of the flow, where that is quicker to read.
        """
        self.results = results
        self.config = config
        self._boxes = results if boxes is None else boxes

    @cached_property
    def scores(self) -> Scores:
        """All scores of the scenes together."""
        overall, classes = self._tracking()
        declared = {name for scene in self.labels for name in scene.declared}
        velocity = velocity_table(self.samples, self.config.velocity, declared)
        return Scores(overall, classes, velocity, self.flow.rows() if self.flow.sampled else {})

    @cached_property
    def labels(self) -> list[SceneLabels]:
        """The classes of each scene."""
        return [_labels(part) for part in self._parts()]

    @cached_property
    def samples(self) -> SampleFile:
        """The velocity errors of each scene."""
        samples = SampleFile()
        for part in self._parts(truth=False):
            samples.append(velocity_samples(part, self.config.velocity))
        return samples

    @cached_property
    def flow(self) -> FlowTable:
        """The flow errors."""
        table = FlowTable()
        for result in self.results:
            table.count(scored_part(result, self.config).flow)
        if table.sampled:
            for result in self.results:
                table.add(scored_part(result, self.config).flow)
        return table

    @cached_property
    def rules(self) -> Rules | None:
        """Of the class-aware evaluation; None where it is class-agnostic (clusters)."""
        if self.config.class_agnostic or not class_aware(self.labels):
            return None
        return rules_for(counted_labels(self.labels))

    @cached_property
    def official(self) -> Metrics | None:
        """The official metrics; None where only counts are defined.

        That is where the evaluation is class-agnostic, or nothing is in range on one side.
        """
        return None if self.rules is None else self._evaluated(self.profiles(self.rules))

    @cached_property
    def filters(self) -> list[ScoreFilter]:
        """Which boxes the scores are made of: per class, or of all classes at once."""
        if self.official is None:
            return [ScoreFilter("")]
        rules = self.official.rules
        return [
            ScoreFilter(label, best_threshold(self.official.curves[label], self.config), range_m)
            for label, range_m in zip(rules.classes, rules.ranges_m, strict=True)
        ]

    @cached_property
    def pooled(self) -> Pooled:
        """The scores of all boxes, whatever their class."""
        total, scenes = together((), self.config), []
        for part in self._parts():
            own = scene_scores(part, ScoreFilter(""), self.config)
            scenes.append(own.clear)
            total = together((total, own), self.config)
        return Pooled(total, scenes)

    @cached_property
    def error_classes(self) -> dict[str, ClassErrors]:
        """The errors of each class by kind; none where the evaluation is class-agnostic."""
        if self.official is None:
            return {}
        return classify_errors(self.prepared(self.official.rules), self.official)

    def profiles(self, rules: Rules) -> list[Profile]:
        """Return the profile of every class; they are not kept, since they are large."""
        batches = [profiles(prepared, rules) for prepared in self.prepared(rules)]
        joined = [Profile.joined(parts) for parts in zip(*batches, strict=True)]
        if rules == self.rules and "official" not in self.__dict__:
            self.official = self._evaluated(joined)  # before they are given away
        return joined

    def prepared(self, rules: Rules) -> Iterator[Prepared]:
        """Yield the boxes of the scenes by the official rules, of a few scenes each."""
        parts = self._parts()
        while batch := list(islice(parts, BATCH)):
            yield prepare_scenes(batch, rules)

    def _evaluated(self, classes: Sequence[Profile]) -> Metrics | None:
        """Return the metrics by the own rules."""
        if self.rules is None or nothing_in_range(classes):
            return None
        return evaluate_profiles(classes, self.rules)

    def _tracking(self) -> tuple[ClassScores, dict[str, ClassScores]]:
        """Return the metrics of all classes together and of each class."""
        if self.official is None:
            return self.pooled.together, {}
        sums = [together((), self.config) for _ in self.filters]
        for part in self._parts():
            own = (scene_scores(part, chosen, self.config) for chosen in self.filters)
            sums = [together(pair, self.config) for pair in zip(sums, own, strict=True)]
        official, total = self.official.classes, self.official.total
        classes = {
            chosen.label: replace(
                counted,
                amota=official[chosen.label]["amota"],
                amotp_m=official[chosen.label]["amotp"],
            )
            for chosen, counted in zip(self.filters, sums, strict=True)
        }
        overall = together(classes.values(), self.config)
        overall = replace(overall, amota=total["amota"], amotp_m=total["amotp"])
        if self.config.match_by == "distance" and self.config.min_score is None:
            overall = replace(overall, mean_mota=total["mota"], mean_motp_m=total["motp"])
        return overall, classes

    def _parts(self, *, truth: bool = True) -> Iterator[SceneResult]:
        """Yield the boxes of each scene that count, without the flow; see `scored_part`."""
        for result in self._boxes:
            boxes = replace(result, flow=FlowSamples.empty())
            yield scored_part(boxes, self.config, truth=truth)


def nothing_in_range(classes: Sequence[Profile]) -> bool:
    """Return whether no true or no tracked box is left to evaluate."""
    sides = zip(*((p.truth_boxes.sum(), p.track_boxes.sum()) for p in classes), strict=True)
    return not classes or not all(any(boxes) for boxes in sides)


def _labels(part: SceneResult) -> SceneLabels:
    truth, tracks = np.unique(part.truth.label), np.unique(part.tracks.label)
    names = frozenset(map(str, (*truth, *tracks)))
    return SceneLabels(frozenset(part.classes), names, bool(np.isin(tracks, truth).any()))

"""Tracks of one run, submission or folder of results beside the truth: what evaluations share."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from mottrack.core.arrays import Mask, Texts
from mottrack.core.result import SceneResult
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.occlusion import hidden_shares
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scored_part, selected

Velocities = Literal["all", "observed", "none"]
Values = Mapping[Hashable, str | float]
"""Values of a column by (frame, identity) of a true box, by its identity, or by None for all."""


@dataclass(frozen=True)
class TrackedScenes:
    """Scenes with truth and tracks, and what else is known of them."""

    results: Sequence[SceneResult]
    """May be read anew each time one is asked for: those of a run are not all held."""
    config: ScoreConfig
    """How boxes are matched, and which count."""
    objects: Sequence[SceneObjects | None] = ()
    """What the tracker received; None, or no tuple at all, where nobody stored it."""
    velocities: Velocities = "all"
    """Of which track boxes the velocity means anything."""
    columns: Mapping[str, Sequence[Values]] = field(default_factory=dict)
    """Further columns of the true boxes: one mapping of values for each scene."""
    counted: tuple[ScoreFilter, ...] | None = None
    """Which boxes count, where that is given; None: as the scores of a run choose them."""
    alike: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Class of a track to other labels that do not deny it (a van, to a detector of cars)."""
    _held: dict[int, tuple[SceneResult, SceneResult]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _hidden: dict[int, dict[tuple[int, int], float]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def result(self, scene: int) -> SceneResult:
        """Return a scene; the last one that was asked for is held, no other."""
        if scene not in self._held:
            self._held.clear()
            result = self.results[scene]
            self._held[scene] = result, scored_part(result, self.config)
        return self._held[scene][0]

    def part(self, scene: int) -> SceneResult:
        """Return it without what lies where nothing is labelled, or out of the region."""
        self.result(scene)
        return self._held[scene][1]

    @cached_property
    def filters(self) -> list[ScoreFilter]:
        """Which boxes the figures are made of: per class, or of all classes at once."""
        if self.counted is not None:
            return list(self.counted)
        return Evaluation(self.results, self.config).filters

    @property
    def unfiltered(self) -> list[ScoreFilter]:
        """The same without a least score."""
        return [replace(one, threshold=-np.inf) for one in self.filters]

    def boxes(self, scene: int, counted: ScoreFilter) -> tuple[TruthTable, TrackTable]:
        """Return the true and the track boxes of a scene that count, in order of their frame."""
        return selected(self.part(scene), counted)

    def hidden(self, scene: int) -> dict[tuple[int, int], float]:
        """Return the hidden share of each true box of a scene by frame and identity."""
        if scene not in self._hidden:
            self._hidden[scene] = hidden_shares(self.part(scene))
        return self._hidden[scene]

    def objects_of(self, scene: int) -> SceneObjects | None:
        """Return what the tracker received where objects are labelled; None where not known."""
        objects = self.objects[scene] if self.objects else None
        if objects is None:
            return None
        result = self.result(scene)
        kept: Mask = result.frames.labelled(objects.frame, objects.centre_m)
        region = self.config.region
        return objects.select(kept if region is None else kept & region.holds(result, objects))

    def known_velocity(self, tracks: TrackTable) -> Mask:
        """Return of which track boxes the velocity is known, (N,)."""
        if self.velocities == "observed":
            return tracks.observed
        return np.full(len(tracks), self.velocities == "all")

    def column(self, name: str, scene: int, truth: TruthTable) -> Texts:
        """Return a further column of true boxes as text, "" where it says nothing, (M,)."""
        values = self.columns[name][scene]
        keys = zip(truth.frame.tolist(), truth.id.tolist(), strict=True)
        found = [values.get((f, i), values.get(i, values.get(None, ""))) for f, i in keys]
        return np.array([v if isinstance(v, str) else f"{v:g}" for v in found], np.str_)

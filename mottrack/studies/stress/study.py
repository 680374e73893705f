"""Runs of several trackers under every damage, and their figures along its amount."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from mottrack.core import SceneResult
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.paired import PairedDifference, Sampled, paired
from mottrack.eval.run_metrics import Resampling
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part
from mottrack.pipeline.scene_run import Member, SceneRun, as_text, run_together
from mottrack.studies.stress.damage import DAMAGES
from mottrack.studies.stress.figures import sampled_figures, stress_key
from mottrack.studies.stress.stressed import Stress, StressedFlow, StressedScene, stressed

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
    figures: dict[str, Sampled]

    def against(self, other: Outcome, figure: str) -> PairedDifference:
        """Return this one's figure minus the other's, on the same scenes."""
        return paired(stress_key(figure), other.figures[figure], self.figures[figure])


class Plan(NamedTuple):
    """What is run."""

    kinds: Sequence[str]
    """Of `DAMAGES`."""
    resamples: int
    """Of the scenes, for the intervals."""


def outcomes(
    experiments: Sequence[Experiment], plan: Plan, tell: Callable[[str], None]
) -> Iterator[Outcome]:
    """Yield the figures of every tracker for every kind of damage and amount.

    Trackers on the same data set meet every damage in lockstep: frames are read, objects found and
    flow measured once for all of them.

    Args:
        experiments: one for each tracker.
        plan: kinds of damage, and resamples.
        tell: is told what runs.

    Raises:
        MottrackError: the data are damaged, or a part refuses its input.
    """
    for group in _groups(experiments):
        dataset = group[0].dataset.make()
        names = group[0].settings.scenes or dataset.scene_names
        scenes = [StressedScene(dataset.scene(name), UNDAMAGED) for name in names]
        clean = _results(group, scenes, UNDAMAGED)
        config = group[0].settings.scores
        whole = [Evaluation(results, config) for results in clean]
        common = Resampling.of(whole, plan.resamples)
        undamaged = [sampled_figures(run, common) for run in whole]
        for kind in plan.kinds:
            tell(f"{DAMAGES[kind].title.lower()}: {', '.join(e.title for e in group)}")
            for amount in DAMAGES[kind].steps:
                stress = Stress(kind, amount)
                found = undamaged
                if amount:
                    worse = _results(group, scenes, stress)
                    runs = [Evaluation(results, config) for results in worse]
                    found = [sampled_figures(run, common) for run in runs]
                for experiment, figures in zip(group, found, strict=True):
                    yield Outcome(experiment.title, stress, figures)


def _groups(experiments: Sequence[Experiment]) -> list[list[Experiment]]:
    """Return the experiments by data set and scenes."""
    groups: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        settings = {"data": experiment.dataset.resolved(), "scenes": experiment.settings.scenes}
        groups.setdefault(as_text(settings), []).append(experiment)
    return list(groups.values())


def _results(
    experiments: Sequence[Experiment], scenes: Sequence[StressedScene], stress: Stress
) -> list[list[SceneResult]]:
    """Return the results of every experiment on every scene."""
    members = [Member(_stressed(e, stress), keep_snapshots=False) for e in experiments]
    found: list[list[SceneResult]] = [[] for _ in members]
    for scene in scenes:
        for results, run in zip(found, run_together(members, stressed(scene, stress)), strict=True):
            if not isinstance(run, SceneRun):
                raise run
            results.append(run.result)
    return found


def _stressed(experiment: Experiment, stress: Stress) -> Experiment:
    settings = experiment.settings.model_copy(update={"score_flow": False})
    flow = experiment.flow
    part = StressedPart(flow.kind, flow.cls, flow.config, stress)
    return replace(experiment, settings=settings, flow=part)


def breaking_amount(found: Sequence[Outcome], figure: str) -> float | None:
    """Return the first amount at which a figure has lost half of what it is undamaged.

    Args:
        found: of one tracker and kind, the undamaged one first.
        figure: better when higher.

    Returns:
        None where it never has.
    """
    whole = found[0].figures[figure].value
    broken = (o.stress.amount for o in found if o.figures[figure].value < BROKEN_SHARE * whole)
    return next(broken, None)


def hurting_amount(found: Sequence[Outcome], figure: str) -> float | None:
    """Return the first amount at which a figure is significantly worse than undamaged.

    Args:
        found: of one tracker and kind, the undamaged one first.
        figure: any.

    Returns:
        None where it never is, or there are too few scenes to tell.
    """
    hurt = (o.stress.amount for o in found[1:] if o.against(found[0], figure).better is False)
    return next(hurt, None)

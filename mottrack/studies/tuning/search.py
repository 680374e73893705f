"""Search for the settings of a tracker with Optuna, on folds of scenes that are left out."""

from __future__ import annotations

import hashlib
import json
import math
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, MottrackError, ResultError
from mottrack.core.result import SceneResult
from mottrack.core.storage import write_text
from mottrack.eval.evaluation import score
from mottrack.eval.paired import PairedDifference
from mottrack.eval.scores import ScoreConfig
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part, load_part
from mottrack.formats.json_text import parse_json
from mottrack.runs.runner import scene_names
from mottrack.studies.tuning.objectives import OBJECTIVES, Objective, differences
from mottrack.studies.tuning.recorded import RecordedScene, tracked
from mottrack.studies.tuning.search_space import Setting, Value, changed

if TYPE_CHECKING:
    import optuna

PARTS = 3
"""A trial is judged after each third of its scenes, and ends there if it lags behind."""
STARTUP_TRIALS = 10
"""Trials at random before the model of the search is used, and none is ended early."""

Values = dict[str, Value]
OnTrial = Callable[[str, int, int, float], None]
"""Receives the name of a search, the trials that are done, their number, and the best figure."""


@dataclass(frozen=True)
class Search:
    """What is sought, and how long."""

    experiment: Experiment
    settings: tuple[Setting, ...]
    objective: Objective
    trials: int
    seed: int

    def tracker(self, values: Mapping[str, Value]) -> Part:
        """Return the experiment's tracker with these values.

        Raises:
            ConfigError: the settings exclude one another.
        """
        config = self.experiment.tracker.config
        if not isinstance(config, StrictModel):
            raise ConfigError(f"tracker '{self.experiment.tracker.kind}' declares no settings")
        return load_part(
            "tracker", {"kind": self.experiment.tracker.kind, **changed(config, values)}
        )

    def figure(self, results: Sequence[SceneResult]) -> float:
        """Return the objective over results together."""
        return self.objective.figure(score(results, self.scoring))

    @property
    def scoring(self) -> ScoreConfig:
        """How boxes are matched."""
        return self.experiment.settings.scores


@dataclass(frozen=True)
class Tuned:
    """The outcome of a search on folds."""

    held_out: tuple[PairedDifference, ...]
    """Default against tuned where each scene took no part in its tuning; the objective first."""
    by_fold: tuple[FoldOutcome, ...]
    best: Values
    """Of the search over all scenes."""


@dataclass(frozen=True)
class FoldOutcome:
    """One fold: values found on the other scenes, and the figure on its own."""

    scenes: tuple[str, ...]
    values: Values
    default: float
    tuned: float


def tune(
    search: Search, scenes: Sequence[RecordedScene], folds: int, out: Path, on_trial: OnTrial
) -> Tuned:
    """Search once for each fold without its scenes, and once on all of them.

    The trials are stored in `out`, so that an interrupted search goes on where it stopped and finds
    the same. Scene k belongs to fold k modulo `folds`.

    Args:
        search: what is sought.
        scenes: its scenes, recorded.
        folds: as `claim` has allowed.
        out: folder that `claim` has taken.
        on_trial: receives the progress.
    """
    default: list[SceneResult] = tracked(scenes, search.experiment.tracker)
    held_out: list[SceneResult] = list(default)
    outcomes = []
    for fold in range(folds):
        own = range(fold, len(scenes), folds)
        others = [scene for k, scene in enumerate(scenes) if k % folds != fold]
        values = _best(search, others, out / f"fold_{fold}.log", on_trial)
        results = tracked([scenes[k] for k in own], search.tracker(values))
        for k, result in zip(own, results, strict=True):
            held_out[k] = result
        before, after = (search.figure(side) for side in ([default[k] for k in own], results))
        names = tuple(result.name for result in results)
        outcomes.append(FoldOutcome(names, values, before, after))
    best = _best(search, scenes, out / "all_scenes.log", on_trial)
    rest = (one for one in OBJECTIVES.values() if one.name != search.objective.name)
    gains = differences((search.objective, *rest), default, held_out, search.scoring)
    # a class-agnostic data set has no AMOTA
    finite = [g for g in gains if math.isfinite(g.baseline) and math.isfinite(g.value)]
    return Tuned(tuple(finite), tuple(outcomes), best)


def claim(search: Search, folds: int, out: Path) -> None:
    """Write down what is sought, or check that it is what the folder's trials belong to.

    Raises:
        ConfigError: there are fewer scenes than folds.
        ResultError: `out` holds the trials of another search.
    """
    names = list(scene_names(search.experiment))
    if len(names) < folds:
        raise ConfigError(f"--folds is {folds}, expected at most {len(names)}, one for each scene")
    identity = {
        "experiment": search.experiment.hash,
        "settings": [setting.described() for setting in search.settings],
        "objective": search.objective.name,
        "seed": search.seed,
        "folds": folds,
        "scenes": names,
    }
    file = out / "search.json"
    if file.exists():
        kept = parse_json(file, file.read_bytes(), "the search of an interrupted command")
        kept = kept if isinstance(kept, dict) else {}
        for name, value in identity.items():
            if kept.get(name) != value:
                expected = f"{value}, as this command has it, or an empty --out"
                raise ResultError(file, name, kept.get(name), expected)
    write_text(file, json.dumps(identity, indent=1) + "\n")


def _best(search: Search, scenes: Sequence[RecordedScene], log: Path, on_trial: OnTrial) -> Values:
    """Return the best values over some scenes; trials that are stored are not run again."""
    optuna = _optuna()
    storage = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(str(log)))
    study = optuna.create_study(
        study_name=log.stem,
        storage=storage,
        load_if_exists=True,
        direction="minimize" if search.objective.lower_is_better else "maximize",
        pruner=optuna.pruners.MedianPruner(n_startup_trials=STARTUP_TRIALS),
    )
    if not study.trials:
        study.enqueue_trial({s.path: s.current for s in search.settings if _inside(s)})
    states = optuna.trial.TrialState
    while (done := len(study.get_trials(deepcopy=False, states=_ended(states)))) < search.trials:
        # a sampler of its own for each trial: what it draws depends on the trials before alone
        seed = _seed(search.seed, log.stem, done)
        study.sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=STARTUP_TRIALS)
        study.optimize(lambda trial: _judged(search, scenes, trial), n_trials=1)
        on_trial(log.stem, done + 1, search.trials, study.best_value)
    return dict(study.best_params)


def _ended(states: Any) -> tuple[Any, ...]:
    return states.COMPLETE, states.PRUNED


def _inside(setting: Setting) -> bool:
    """Return whether the present value is among those that are tried."""
    if setting.choices:
        return setting.current in setting.choices
    current = setting.current
    return isinstance(current, int | float) and setting.low <= current <= setting.high


def _judged(search: Search, scenes: Sequence[RecordedScene], trial: optuna.Trial) -> float:
    """Return the figure of one trial; ends it early where it lags behind."""
    optuna = _optuna()
    values = {setting.path: _suggested(trial, setting) for setting in search.settings}
    worst = math.inf if search.objective.lower_is_better else -math.inf
    try:
        tracker = search.tracker(values)
    except MottrackError:  # settings that exclude one another
        return worst
    results: list[SceneResult] = []
    parts = min(PARTS, len(scenes))
    for part in range(parts):
        first, end = (len(scenes) * k // parts for k in (part, part + 1))
        results += tracked(scenes[first:end], tracker)
        figure = search.figure(results)
        trial.report(figure, part)
        if part + 1 < parts and trial.should_prune():
            raise optuna.TrialPruned
    return figure


def _suggested(trial: optuna.Trial, setting: Setting) -> Value:
    if setting.choices:
        chosen = trial.suggest_categorical(setting.path, setting.choices)
        return typing.cast("Value", chosen)
    if setting.whole:
        low, high = math.ceil(setting.low), math.floor(setting.high)
        return trial.suggest_int(setting.path, low, high, log=setting.logarithmic)
    return trial.suggest_float(setting.path, setting.low, setting.high, log=setting.logarithmic)


def _seed(seed: int, name: str, number: int) -> int:
    digest = hashlib.sha256(f"{seed}/{name}/{number}".encode()).digest()
    return int.from_bytes(digest[:4], "big")


def _optuna() -> Any:
    """Return the module; it is an extra, and loads slowly.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise ConfigError("optuna is not installed; expected pip install mottrack[tune]") from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna

"""F: studies, settings and parts of a user's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from mottrack import Pipeline
from mottrack.experiment.configs import find_config
from mottrack.experiment.experiment import load_experiments
from mottrack.studies.folds.plan import read_plan
from mottrack.studies.folds.study import study
from mottrack.studies.tuning.objectives import OBJECTIVES
from mottrack.studies.tuning.search import Search, claim
from mottrack.studies.tuning.search_space import settings_of
from mottrack.trackers import KalmanTracker
from tests.fuzz.faults.printed import REPOSITORY, Faults, Printed, command, frame, raised
from tests.fuzz.faults.section_e import submission

Change = Callable[[dict[str, Any]], object]


def folds(change: Change) -> Printed:
    """What `mottrack folds` says of a small study whose file was changed."""

    def call(root: Path) -> None:
        group: dict[str, Any] = {
            "name": "world",
            "experiment": "demo",
            "rules": "nuscenes",
            "overrides": ["dataset.duration_s=0.2", "flow=zero", "score_flow=false"],
            "scenes": {"synthetic-s1000-0000": [], "synthetic-s1000-0001": []},
        }
        variants = {"default": {}, "wide": {"association": {"gate": 8.0}}}
        plan: dict[str, Any] = {"groups": [group], "variants": variants, "folds": 2}
        change(plan)
        (root / "study.yaml").write_text(yaml.safe_dump(plan))
        study(read_plan(str(root / "study.yaml")), root, lambda _: None)

    return without_paths(raised(call))


def without_paths(printed: Printed) -> Printed:
    """The same text without the folders of this machine."""
    return lambda root: printed(root).replace(f"{REPOSITORY}/", "").replace(str(root), "DATA")


def of_group(**changes: Any) -> Printed:
    return folds(lambda plan: plan["groups"][0].update(changes))


def tuned(*wanted: str) -> Printed:
    """What `mottrack tune` says of its --setting."""
    return raised(lambda _root: settings_of(KalmanTracker.Config(), wanted) and None)


def claimed(number: int, kept: str = "", before: int = 0) -> Printed:
    """What `mottrack tune` says of its number of folds and of what lies in its folder.

    Args:
        number: of folds.
        kept: content of the file of an earlier search; empty: none.
        before: folds of an earlier search in the folder; 0: none.
    """

    def call(root: Path) -> None:
        (experiment,) = load_experiments("demo", ["flow=zero", "dataset.scenes=3"])
        settings = tuple(settings_of(KalmanTracker.Config(), ["association.gate"]))
        out = root / "tune"
        out.mkdir(exist_ok=True)
        (out / "search.json").unlink(missing_ok=True)
        if kept:
            (out / "search.json").write_text(kept)
        search = Search(experiment, settings, OBJECTIVES["amota"], 1, 0)
        for folds in (before, number) if before else (number,):
            claim(search, folds, out)

    return raised(call)


def own_flow(fault: str) -> Printed:
    """What a pipeline says of a flow source of the user's own with a fault."""

    def call(_root: Path) -> None:
        source = f"flow={{kind: 'tests.plugins.faulty_plugins:CarelessFlow', fault: {fault}}}"
        pipeline = Pipeline.from_config("demo", source)
        for k in (1, 2):
            pipeline.feed(**frame(k))

    return raised(call)


def velocities(value: list[Any]) -> Printed:
    return submission(lambda samples: samples[0][0].update(velocity=value))


FAULTS: Faults = {
    "F1 a path of a configuration that does not exist": raised(lambda _: find_config("my.yml")),
    "F1 a file for training that is run": without_paths(
        command("run", "train_small", "--out", "{root}/f", word="mottrack:")
    ),
    "F2 `folds`: an unknown key": folds(lambda plan: plan.update(fold=3)),
    "F2 `folds`: a scene that does not exist": of_group(scenes={"a": [], "b": []}),
    "F2 `folds`: one fold": folds(lambda plan: plan.update(folds=1)),
    "F2 `folds`: more folds than scenes": folds(lambda plan: plan.update(folds=3)),
    "F2 `folds`: a choice that is no variant": folds(lambda plan: plan.update(choose=["narrow"])),
    "F2 `folds`: a wrong setting of a variant": folds(
        lambda plan: plan["variants"].update(odd={"association": {"gate": -1}})
    ),
    "F2 `folds`: a wrong setting of a group": of_group(overrides=["flow=zeros"]),
    "F2 `folds`: stored tracks that are not there": of_group(tracks={"peer": ["peer.json"]}),
    "F2 `folds`: stored tracks of no file": of_group(tracks={"peer": []}),
    "F2 `folds`: stored tracks named as a variant": of_group(tracks={"wide": ["peer.json"]}),
    "F2 `folds`: a path out of the folder of data": of_group(tracks={"peer": ["../peer.json"]}),
    "F3 `tune`: a value that the setting does not have": tuned("association.metric=near|far"),
    "F3 `tune`: a range beyond the setting's": tuned("association.gate=-5..5"),
    "F3 `tune`: a setting twice": tuned("association.gate", "association.gate=1..5"),
    "F3 `tune`: more folds than scenes": claimed(4),
    "F3 `tune`: a folder of another search": claimed(2, before=3),
    "F3 `tune`: a damaged `search.json`": claimed(2, "{"),
    "F4 a flow source of your own: covariance NaN": own_flow("nan"),
    "F4 a flow source of your own: covariance negative": own_flow("negative"),
    "F4 a flow source of your own: covariance not symmetric": own_flow("asymmetric"),
    "F4 a flow source of your own: a field of another stamp": own_flow("stamp"),
    "F5 `eval nuscenes`: a velocity of texts": velocities(["a", "b"]),
    "F5 `eval nuscenes`: a velocity of 3,000 m/s": velocities([3000.0, 0.0]),
    "F6 a path for results below a file": command(
        "train", "train_small", "--out", "{root}/submission.json/run"
    ),
    "F6 a path for results at which a file is": command(
        "folds", "recorded", "--data", "{root}", "--out", "{root}/submission.json"
    ),
}

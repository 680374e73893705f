"""The file of a study on folds: groups of scenes, settings of a tracker, and what is chosen by."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, DataError, no_such_file
from mottrack.experiment.configs import shipped_folder
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.experiment.plugins import Part, load_part
from mottrack.experiment.validation_message import format_validation_error
from mottrack.formats.files import inside
from mottrack.formats.yaml_file import read_yaml

Rules = Literal["nuscenes", "kitti"]


class Group(StrictModel):
    """Scenes of one data set with the detections of one detector, scored together."""

    name: str = Field(description="in tables")
    experiment: str = Field(description="experiment file: data set, objects and flow; its tracker")
    root: Path | None = Field(
        None, description="folder of the data set, below that of all data; null: it has none"
    )
    rules: Rules = Field(description="nuscenes: by centre distance; kitti: AB3DMOT's, 3-D IoU .25")
    overrides: list[str] = Field(default=[], description="of the experiment, for all scenes")
    scenes: dict[str, list[str]] = Field(
        min_length=1, description="scene to overrides of its own, such as its file of detections"
    )
    tracks: dict[str, Annotated[list[Path], Field(min_length=1)]] = Field(
        default={},
        description="stored output of other trackers below the folder of all data: a submission "
        "(nuscenes), folders of text files (kitti)",
    )

    def experiments(self, data: Path) -> dict[str, Experiment]:
        """Return the experiment of each scene.

        Raises:
            ConfigError: a setting is wrong, or there are several variants.
            DataError: a path leads out of the folder of all data.
        """
        return {scene: self._experiment(scene, data) for scene in self.scenes}

    def stored(self, name: str, data: Path) -> list[Path]:
        """Return the files (nuscenes) or folders (kitti) of another tracker's stored output.

        Raises:
            DataError: one is missing, or leads out of the folder of all data.
        """
        paths = [inside(data, str(path), follow_links=True) for path in self.tracks[name]]
        texts = [folder / f"{scene}.txt" for folder in paths for scene in self.scenes]
        for file in texts if self.rules == "kitti" else paths:
            if not file.is_file():
                raise DataError(file, "file", "missing", f"the tracks of {name}")
        return paths

    def _experiment(self, scene: str, data: Path) -> Experiment:
        root = []
        if self.root is not None:
            root = [f"dataset.root={inside(data, str(self.root), follow_links=True)}"]
        own = [*root, *self.overrides, *self.scenes[scene]]
        try:
            found = load_experiments(self.experiment, [*own, f'scenes=["{scene}"]'])
        except ConfigError as error:
            raise ConfigError(f"group {self.name}: {error}") from error
        if len(found) > 1:
            names = ", ".join(one.variant for one in found)
            raise ConfigError(f"group {self.name}: {len(found)} variants ({names}), expected one")
        return found[0]


class Plan(StrictModel):
    """A study on folds."""

    groups: list[Group] = Field(min_length=1)
    tracker: str = Field("kalman", description="kind of the tracker whose settings vary")
    variants: dict[str, dict[str, Any]] = Field(
        min_length=1, description="name to settings of the tracker; the first is the reference"
    )
    choose: list[str] = Field(
        default=[], description="variants among which each fold chooses; empty: none is chosen"
    )
    objective: list[Literal["amota", "samota", "mota", "hota"]] = Field(
        default=["amota"],
        min_length=1,
        description="figures whose mean over classes and groups is highest; of kitti's groups "
        "amota stands for samota, which is scaled as that of nuscenes is",
    )
    folds: int = Field(4, ge=2, description="parts of the scenes, left out in turn")
    detector: bool = Field(
        False, description="count detections, estimate noise without the fold, test consistency"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = ", ".join(self.variants)
        for name in self.choose:
            if name not in self.variants:
                raise ValueError(f"choose to name variants ({known}), found '{name}'")
        names = [group.name for group in self.groups]
        if len(set(names)) < len(names):
            raise ValueError(f"groups of a name each, found {', '.join(names)}")
        for group in self.groups:
            for name in group.tracks:
                if name in self.variants:
                    text = f"tracks of other names than the variants ({known})"
                    raise ValueError(f"{text}, found '{name}' in group {group.name}")
        return self

    @property
    def trackers(self) -> dict[str, Part]:
        """The tracker with each variant's settings.

        Raises:
            ConfigError: a setting is wrong.
        """
        made = {}
        for name, settings in self.variants.items():
            try:
                made[name] = load_part("tracker", {"kind": self.tracker, **settings})
            except ConfigError as error:
                raise ConfigError(f"variants.{name}: {error}") from error
        return made

    @property
    def reference(self) -> str:
        """The first variant."""
        return next(iter(self.variants))

    @property
    def fold_of(self) -> dict[str, int]:
        """The fold of each scene; a scene of two groups is in one fold, since its truth is one."""
        names = sorted({scene for group in self.groups for scene in group.scenes})
        return {name: k % self.folds for k, name in enumerate(names)}


def read_plan(name: str) -> Plan:
    """Read a plan: a path, or the name of one that is shipped in `configs/folds`.

    Raises:
        ConfigError: there is none, or it is not well formed.
        DataError: the file can't be read.
    """
    shipped = {path.stem: path for path in sorted((shipped_folder() / "folds").glob("*.yaml"))}
    path = Path(name) if Path(name).is_file() else shipped.get(name)
    if path is None:
        raise no_such_file("study on folds", name, shipped)
    tree = read_yaml(path)
    if not tree:
        raise DataError(path, "content", "no setting at all", "groups and variants")
    try:
        plan = Plan.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(f"{path}: {format_validation_error(error, Plan)}") from error
    if plan.folds > len(plan.fold_of):
        most = f"{len(plan.fold_of)}, the number of scenes"
        raise ConfigError(f"{path}: folds is {plan.folds}, expected at most {most}")
    return plan

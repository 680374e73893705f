"""Experiments: data set, objects, flow source, tracker and scores, composed from YAML files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mottrack.core.errors import ConfigError, DataError
from mottrack.experiment.configs import find_config, find_group
from mottrack.experiment.overrides import GROUPS, Choice, expand, fitting, parse_override, set_key
from mottrack.experiment.plugins import Part, has_key, load_part
from mottrack.experiment.settings import Settings
from mottrack.experiment.validation_message import format_validation_error
from mottrack.formats.yaml_file import read_yaml


@dataclass(frozen=True)
class Experiment:
    """A complete, checked configuration."""

    dataset: Part
    objects: Part
    flow: Part
    tracker: Part
    settings: Settings
    variant: str = ""
    """Name within a sweep; empty if it is the only one."""

    @property
    def title(self) -> str:
        """Name in tables: what varies in the sweep, else flow and tracker."""
        return self.variant or f"{self.flow.kind}+{self.tracker.kind}"

    @property
    def name(self) -> str:
        """Name of the experiment; of the data set where the file's own was replaced."""
        return self.settings.name or self.data

    @property
    def data(self) -> str:
        """Data set and the name of its folder."""
        root = self.dataset.resolved().get("root")
        return f"{self.dataset.kind}: {Path(str(root)).name}" if root else self.dataset.kind

    @property
    def parts(self) -> tuple[Part, ...]:
        """Dataset, objects, flow and tracker."""
        return self.dataset, self.objects, self.flow, self.tracker

    def resolved(self) -> dict[str, Any]:
        """Return every setting, defaults included, as plain data."""
        parts = {g: part.resolved() for g, part in zip(GROUPS, self.parts, strict=True)}
        return {**parts, **self.settings.model_dump(mode="json")}

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved configuration: equal settings, equal hash."""
        return hash_of(self.resolved())


def hash_of(resolved: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a resolved configuration: equal settings, equal hash."""
    canonical = json.dumps(resolved, sort_keys=True, default=str)
    return hashlib.sha256(canonical.encode()).hexdigest()


def load_experiments(config: str, overrides: Sequence[str] = ()) -> list[Experiment]:
    """Compose an experiment file, its groups and the overrides; a sweep gives several.

    Args:
        config: path of a YAML file, or the name of one that is shipped.
        overrides: ``key=value`` texts; ``flow=zero,icp`` makes a sweep.

    Raises:
        ConfigError: a key, a name or a value is wrong.
        DataError: a file can't be read.
    """
    path = find_config(config)
    return compose(_settings_in(path), overrides, path)


def load_to_stream(config: str, overrides: Sequence[str] = ()) -> Experiment:
    """Compose one experiment; leave the file's data set out unless an override names one.

    Raises:
        ConfigError: a key, a name or a value is wrong, or there are several variants.
        DataError: the file can't be read.
    """
    path = find_config(config)
    tree = _settings_in(path)
    if not any(parse_override(text)[0].startswith("dataset") for text in overrides):
        tree.pop("dataset", None)
    experiments = compose(tree, overrides, path)
    if len(experiments) > 1:
        variants = ", ".join(e.variant for e in experiments)
        raise ConfigError(f"{path}: {len(experiments)} variants ({variants}), expected one: choose")
    return experiments[0]


def _settings_in(path: Path) -> dict[str, Any]:
    """Read an experiment file; refuse one without any setting, for which nobody asks."""
    tree = read_yaml(path)
    if not tree:
        raise DataError(path, "content", "no setting at all", "at least one of dataset, flow, ...")
    return tree


def compose(tree: Mapping[str, Any], overrides: Sequence[str], path: Path) -> list[Experiment]:
    """Compose experiments from the mapping that an experiment file holds.

    Args:
        tree: keys to values; a list under a group makes a sweep.
        overrides: ``key=value`` texts.
        path: names the file in errors; groups are searched for beside it.

    Raises:
        ConfigError: a key, a name or a value is wrong.
        DataError: the file of a group can't be read.
    """
    variants = expand(tree, overrides)
    names = [name for name, _ in variants]
    if len(set(names)) != len(names):
        raise ConfigError(f"{path}: two variants of the sweep have the same name: {sorted(names)}")

    def knows(choices: Sequence[Choice], group: str, key: str) -> bool:
        chosen = _plain(tree) | {key: value for key, value in choices if key in GROUPS}
        settings = _group_settings(group, chosen.get(group, DEFAULTS[group]), path)
        return has_key(group, str(settings.get("kind")), key)

    several = any(len({str(dict(v.choices).get(g)) for v in variants}) > 1 for g in GROUPS)
    variants = fitting(variants, knows) if several else variants
    return [_compose_one(tree, choices, name, path) for name, choices in variants]


def _plain(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy without aliases."""
    copied: dict[str, Any] = json.loads(json.dumps(tree, default=str))
    return copied


def _compose_one(
    base: Mapping[str, Any], choices: Sequence[Choice], variant: str, path: Path
) -> Experiment:
    tree = _plain(base)
    tree |= {key: value for key, value in choices if key in GROUPS}
    for group in GROUPS:
        choice = tree.get(group, DEFAULTS[group])
        tree[group] = deepcopy(_group_settings(group, choice, path))
    for key, value in choices:
        if key not in GROUPS:
            set_key(tree, key, value)
    if _kind(tree["dataset"]) != _kind(base.get("dataset")) and "dataset" in base:
        keys = {key for key, _ in choices}
        tree["name"] = tree.get("name", "") if "name" in keys else ""  # it names the file's data
    try:
        parts = {group: load_part(group, tree.pop(group)) for group in GROUPS}
        settings = Settings.model_validate(tree)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    except ValidationError as error:
        raise ConfigError(f"{path}: {format_validation_error(error, _WholeFile)}") from error
    return Experiment(**parts, settings=settings, variant=variant)


def _kind(choice: Any) -> Any:
    return choice.get("kind") if isinstance(choice, Mapping) else choice


DEFAULTS = {
    "dataset": {"kind": "synthetic"},
    "objects": {"kind": "detections"},
    "flow": {"kind": "zero"},
    "tracker": {"kind": "kalman"},
}


class _WholeFile(Settings):
    """All top-level keys of an experiment file, for the hint in errors."""

    dataset: Any = None
    objects: Any = None
    flow: Any = None
    tracker: Any = None


def _group_settings(group: str, choice: Any, path: Path) -> dict[str, Any]:
    """Return the settings of a group: of the file ``flow/icp.yaml`` if any, else the bare kind."""
    if isinstance(choice, dict):
        return choice
    if not isinstance(choice, str):
        raise ConfigError(f"{path}: {group} is {choice!r}, expected a name or a mapping with kind")
    file = find_group(group, choice, path.parent)
    if file is None:
        return {"kind": choice}
    return {"kind": choice, **read_yaml(file)}

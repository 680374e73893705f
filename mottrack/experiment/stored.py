"""The configuration of a finished run, read to be shown: nothing that it names is imported."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from mottrack.core.errors import ConfigError, ResultError
from mottrack.experiment.experiment import Experiment, hash_of
from mottrack.experiment.overrides import GROUPS
from mottrack.experiment.plugins import Part
from mottrack.experiment.settings import Settings
from mottrack.experiment.validation_message import format_validation_error
from mottrack.formats.yaml_file import read_yaml


class NotImported:
    """Stands for the class of a part of a finished run: a stranger's folder may name any."""

    def __init__(self, *_: object, **__: object) -> None:
        raise ConfigError("a stored run is looked at, its parts are not made again")


def stored_experiment(config_file: Path, stored_hash: object, variant: str) -> Experiment:
    """Read the resolved configuration of a finished run.

    Args:
        config_file: its `config.yaml`.
        stored_hash: SHA-256 that the run noted of it; None where it noted none.
        variant: name of the run within a sweep.

    Raises:
        DataError: the file is missing or no YAML.
        ResultError: it was changed after the run, or is no configuration.
    """
    tree = read_yaml(config_file)
    if stored_hash is not None and stored_hash != hash_of(tree):
        found = f"those of {hash_of(tree)[:12]}, changed after the run"
        raise ResultError(config_file, "settings", found, f"those of {str(stored_hash)[:12]}")
    parts = {group: _part(config_file, group, tree.pop(group, None)) for group in GROUPS}
    try:
        settings = Settings.model_validate(tree)
    except ValidationError as error:
        text = format_validation_error(error, Settings)
        raise ResultError(config_file, "settings", text, "those of a run") from error
    return Experiment(**parts, settings=settings, variant=variant)


def _part(config_file: Path, group: str, settings: object) -> Part:
    kind = settings.get("kind") if isinstance(settings, dict) else None
    if not isinstance(settings, dict) or not isinstance(kind, str):
        raise ResultError(config_file, group, settings, "a mapping with kind")
    return Part(kind, NotImported, {k: v for k, v in settings.items() if k != "kind"})

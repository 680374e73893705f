"""The configuration of a pipeline that is fed by its caller: an experiment without its data."""

from __future__ import annotations

from collections.abc import Sequence

from mottrack.core.errors import ConfigError
from mottrack.pipeline.configs import find_config
from mottrack.pipeline.experiment import Experiment, compose
from mottrack.pipeline.overrides import parse_override
from mottrack.pipeline.yaml_file import read_yaml


def load_to_stream(config: str, overrides: Sequence[str] = ()) -> Experiment:
    """Composes one experiment; the file's data set is left out unless an override speaks of it.

    Raises:
        ConfigError: a key, a name or a value is wrong, or several variants are left.
        DataError: the file can't be read.
    """
    path = find_config(config)
    tree = read_yaml(path)
    if not any(parse_override(text)[0].startswith("dataset") for text in overrides):
        tree.pop("dataset", None)
    experiments = compose(tree, overrides, path)
    if len(experiments) > 1:
        variants = ", ".join(e.variant for e in experiments)
        raise ConfigError(f"{path}: {len(experiments)} variants ({variants}), expected one: choose")
    return experiments[0]

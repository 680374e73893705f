"""The generated reference is complete."""

from __future__ import annotations

import importlib

import pytest

from mottrack.experiment.plugins import PARTS
from mottrack.experiment.settings import Settings
from mottrack.flow.pillarflow.training.config import TrainConfig

pytestmark = pytest.mark.usefixtures("page_makers")


def test_every_plugin_and_every_key_is_documented() -> None:
    configuration, fields = (importlib.import_module(m) for m in ("configuration", "fields"))
    page = configuration.page()
    for group, kind in PARTS.items():
        for name, entry in kind.table.items():
            assert f"### {group}={name}\n" in page
            assert entry.summary in page
            for row in fields.rows(configuration.model_of(entry), f"{group}."):
                assert f"| `{row.key}` |" in page
    assert "| `tracker.track_management.max_coast_s` | number, ≥&nbsp;0 | `6` |" in page
    assert "| `pair_s` | number, >&nbsp;0, ≤&nbsp;0.5 | `0.1` |" in page


def test_every_setting_has_a_description() -> None:
    configuration, fields = (importlib.import_module(m) for m in ("configuration", "fields"))
    entries = [entry for kind in PARTS.values() for entry in kind.table.values()]
    models = [Settings, TrainConfig, *(configuration.model_of(entry) for entry in entries)]
    silent = {(m.__name__, r.key) for m in models for r in fields.rows(m) if not r.description}
    assert not silent - ALLOWED


ALLOWED = {("Settings", "scores.match_by"), ("Settings", "scores.velocity.vulnerable_classes")}
"""Their names and values are self-explanatory."""


def test_every_command_and_every_option_is_documented() -> None:
    command_line = importlib.import_module("command_line")
    page = command_line.page()
    found = dict(command_line.commands())
    assert {"mottrack run", "mottrack eval nuscenes", "mottrack estimate-noise"} <= found.keys()
    for name, command in found.items():
        assert f"## {name}\n" in page
        assert command.help, name
        for option in (o for p in command.params for o in p.opts if o.startswith("--")):
            assert f"`{option}`" in page

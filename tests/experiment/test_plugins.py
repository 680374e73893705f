"""Plug-in classes: what they must declare, and what they are constructed with."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import pytest

from mottrack.config import StrictModel
from mottrack.core import BevGrid, ConfigError, FlowSource, FlowSourceBase, ObjectSourceBase
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.experiment.plugins import PARTS, load_part


class MethodsOnly:
    def estimate(self, past: Any, current: Any) -> None: ...

    def reset(self) -> None: ...


class Declared(MethodsOnly):
    needs_sweeps, stateful, past_sweeps, error_model = False, True, 1, NO_OUTLIERS

    def __init__(self, grid: BevGrid) -> None:
        self.grid = grid


class Inherited(FlowSourceBase):
    def __init__(self, reach_m: float = 1.0, *, grid: BevGrid) -> None:
        self.reach_m, self.grid = reach_m, grid

    def estimate(self, past: Any, current: Any) -> None: ...


class Configured(Inherited):
    class Config(StrictModel):
        reach_m: float = 2.0

    def __init__(self, config: Config, *, grid: BevGrid) -> None:
        super().__init__(config.reach_m, grid=grid)


class WithoutGrid(Inherited):
    def __init__(self) -> None: ...


class WrongType(Inherited):
    error_model = "sound"


class Detector(ObjectSourceBase):
    def objects(self, frame: Any, sweep: Any) -> None: ...


@pytest.fixture(autouse=True)
def _own(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("own")
    vars(module).update({k: v for k, v in globals().items() if isinstance(v, type)})
    monkeypatch.setitem(sys.modules, "own", module)


@pytest.mark.parametrize("kind", ["Declared", "Inherited", "Configured"])
def test_every_flow_source_is_constructed_with_the_grid_of_the_experiment(kind: str) -> None:
    grid = BevGrid(cell_m=0.5)
    source = load_part("flow", {"kind": f"own:{kind}"}).make(grid=grid)
    assert isinstance(source, FlowSource)
    assert source.grid is grid


def test_settings_reach_a_class_with_and_without_a_config() -> None:
    for kind in ("Inherited", "Configured"):
        part = load_part("flow", {"kind": f"own:{kind}", "reach_m": 4.0})
        assert part.make(grid=BevGrid()).reach_m == 4.0


def test_the_base_classes_have_the_defaults() -> None:
    assert (Inherited.needs_sweeps, Inherited.stateful) == (True, False)
    assert Inherited.error_model == NO_OUTLIERS
    source = load_part("objects", {"kind": "own:Detector"}).make()
    assert (source.needs_sweeps, source.needs_detections) == (True, False)
    source.reset()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            {"kind": "own:MethodsOnly"},
            r"flow source 'own:MethodsOnly' does not declare needs_sweeps, expected a class "
            r"attribute of type bool; mottrack.core.FlowSourceBase has a default to inherit",
        ),
        ({"kind": "own:WrongType"}, "declare error_model, .* of type VelocityErrorModel"),
        (
            {"kind": "own:WithoutGrid"},
            r"can't be constructed with \(grid=...\): got an unexpected keyword argument 'grid'",
        ),
        ({"kind": "own:Inherited", "grid": 1}, r"grid is set by grid\.\*, for all parts"),
        ({"kind": "own:Inherited", "reach": 1}, r"constructed with \(reach=1, grid=...\)"),
        ({"kind": "own:Configured", "reach": 1}, "did you mean 'reach_m'"),
    ],
)
def test_an_incomplete_class_or_a_wrong_setting_is_refused(
    settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        load_part("flow", settings)


@pytest.mark.parametrize(
    ("group", "name"), [(group, name) for group, kind in PARTS.items() for name in kind.table]
)
def test_every_shipped_class_can_be_imported_and_has_a_summary(group: str, name: str) -> None:
    target, summary = PARTS[group].table[name]
    module, _, class_name = target.partition(":")
    assert isinstance(vars(import_module(module))[class_name], type)
    assert summary.endswith(".")

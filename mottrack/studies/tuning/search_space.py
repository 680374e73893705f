"""The settings that a search varies, with ranges from the configuration models."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Lt
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from mottrack.config import StrictModel
from mottrack.core.errors import ConfigError, unknown_name

FACTOR = 4.0
"""A number without bounds on both sides is sought from a quarter to four times its value."""
INSIDE = 1e-3
"""A bound that is excluded is approached to this share of the range."""
STEPS = "..", "|"
"""Between the ends of a range, and between choices, in `key=low..high` and `key=a|b`."""

Value = float | int | bool | str


@dataclass(frozen=True)
class Setting:
    """One setting of a tracker with the values that are tried."""

    path: str
    """Names of the keys from the tracker's configuration down, joined by dots."""
    current: Value | None
    """In the experiment: the first trial, if it is one of the values."""
    choices: tuple[Value, ...] = ()
    """Empty: a number from `low` to `high`."""
    low: float = 0.0
    high: float = 0.0
    logarithmic: bool = False

    @property
    def whole(self) -> bool:
        """Whether the setting is an integer."""
        return isinstance(self.current, int) and not isinstance(self.current, bool)

    def described(self) -> str:
        """Return the range as `key=low..high` or `key=a|b`."""
        if self.choices:
            return f"{self.path}={'|'.join(map(str, self.choices))}"
        return f"{self.path}={self.low:.6g}..{self.high:.6g}"


def settings_of(config: StrictModel, wanted: Sequence[str]) -> list[Setting]:
    """Return the settings that are named, as `key`, `key=low..high` or `key=a|b`.

    Raises:
        ConfigError: a key does not exist, or its values cannot be sought as given.
    """
    if not wanted:
        raise ConfigError("no setting to tune; expected --setting KEY, KEY=LOW..HIGH or KEY=A|B")
    found: list[Setting] = []
    for text in wanted:
        path, _, values = text.partition("=")
        if any(path == setting.path for setting in found):
            raise ConfigError(f"--setting {path} is given twice, expected each key once")
        owner, name = _owner(config, path)
        field = type(owner).model_fields[name]
        setting = _setting(path, getattr(owner, name), field, values)
        _check_values(setting, field)
        found.append(setting)
    return found


def changed(config: StrictModel, values: Mapping[str, Value]) -> dict[str, Any]:
    """Return the settings that differ from the model's defaults, with values at their paths."""
    tree: dict[str, Any] = config.model_dump(mode="json", exclude_unset=True)
    for path, value in values.items():
        *above, name = path.split(".")
        node = tree
        for key in above:
            node = node.setdefault(key, {})
        node[name] = value
    return tree


def _owner(config: StrictModel, path: str) -> tuple[StrictModel, str]:
    """Return the model that holds the last key of a path, and that key."""
    *above, name = path.split(".")
    owner = config
    for key in above:
        _check(owner, key, path)
        below = getattr(owner, key)
        if not isinstance(below, StrictModel):
            raise ConfigError(f"--setting {path}: {key} holds no settings")
        owner = below
    _check(owner, name, path)
    return owner, name


def _check(owner: StrictModel, key: str, path: str) -> None:
    if key not in type(owner).model_fields:
        raise unknown_name("key of --setting", path or "''", type(owner).model_fields)


def _setting(path: str, current: Any, field: FieldInfo, values: str) -> Setting:
    between, choice = STEPS
    kinds = _choices(field.annotation)
    if choice in values:
        return Setting(path, current, tuple(_parsed(v, current) for v in values.split(choice)))
    if between in values:
        return _number(path, current, *_ends(path, values))
    if values:
        raise ConfigError(f"--setting {path}={values}: expected LOW..HIGH or A|B")
    if kinds:
        return Setting(path, current, kinds)
    if isinstance(current, bool) or not isinstance(current, int | float):
        raise ConfigError(
            f"--setting {path}: its value is {current!r}; give its range, {path}=LOW..HIGH or A|B"
        )
    return _number(path, current, *_bounds(field, float(current), path))


def _check_values(setting: Setting, field: FieldInfo) -> None:
    """Refuse a choice, or an end of a range, that the configuration model refuses for its key."""
    ends: tuple[Value, ...] = (setting.low, setting.high)
    if setting.whole:
        ends = math.ceil(setting.low), math.floor(setting.high)
    kind: Any = Annotated[field.annotation, field]
    accepted: TypeAdapter[Any] = TypeAdapter(kind)
    for value in setting.choices or ends:
        try:
            accepted.validate_python(value)
        except ValidationError as error:
            expected = error.errors()[0]["msg"].lower()
            text = f"--setting {setting.described()}: {setting.path} is {value!r}, expected"
            raise ConfigError(f"{text}: {expected}") from error


def _choices(annotation: Any) -> tuple[Value, ...]:
    """Return the values of a literal or a bool; empty otherwise."""
    if annotation is bool:
        return (False, True)
    if typing.get_origin(annotation) is Literal:
        return typing.get_args(annotation)
    if typing.get_origin(annotation) is types.UnionType:
        return ()
    return ()


def _bounds(field: FieldInfo, current: float, path: str) -> tuple[float, float]:
    """Return the ends of the range of a number: its own bounds, else a factor about its value."""
    low, high = None, None
    for rule in field.metadata:
        if isinstance(rule, Ge | Gt):
            low = float(rule.ge if isinstance(rule, Ge) else rule.gt)  # type: ignore[arg-type]
        if isinstance(rule, Le | Lt):
            high = float(rule.le if isinstance(rule, Le) else rule.lt)  # type: ignore[arg-type]
    if low is not None and high is not None:
        margin = INSIDE * (high - low)
        return low + margin, high - margin
    if current == 0.0:
        raise ConfigError(f"--setting {path}: its value is 0; give its range, {path}=LOW..HIGH")
    ends = sorted((current / FACTOR, current * FACTOR))
    return ends[0] if low is None else max(low, ends[0]), ends[1]


def _ends(path: str, values: str) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in values.split(STEPS[0]))
    except ValueError as error:
        raise ConfigError(f"--setting {path}={values}: expected two numbers LOW..HIGH") from error
    if not low < high:
        raise ConfigError(f"--setting {path}={values}: expected LOW below HIGH")
    return low, high


def _number(path: str, current: Any, low: float, high: float) -> Setting:
    # a range over more than a factor of ten is sought by ratios
    return Setting(path, current, (), low, high, low > 0.0 and high / low > 10.0)


def _parsed(text: str, current: Any) -> Value:
    """Return a choice in the type of the present value."""
    if isinstance(current, bool):
        return text == "true"
    try:
        return type(current)(text) if isinstance(current, int | float) else text
    except ValueError as error:
        raise ConfigError(f"{text!r} is no {type(current).__name__}") from error

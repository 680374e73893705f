"""Tables as data frames of other libraries: Arrow, pandas, polars."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ConfigError

FLAT_NAMES = {
    "centre_m": ("x", "y", "z"),
    "size_m": ("length", "width", "height"),
    "yaw_rad": ("yaw",),
    "velocity_mps": ("vx", "vy"),
    "velocity_covariance_m2ps2": ("vxx", "vxy", "vyx", "vyy"),
    "xy_m": ("x", "y"),
}
"""Names of the single values of a column: those of the csv files (docs/own_logs.md), in metres,
radians, metres a second."""


class Tabular:
    """Something with columns of equal length, one row a box, a frame or a figure."""

    __slots__ = ()

    def flat(self) -> dict[str, NDArray[Any]]:
        """Return the columns by name, (N,) each: a vector is a column for each of its numbers."""
        raise NotImplementedError

    def to_arrow(self) -> Any:
        """Return a `pyarrow.Table` with the columns of `flat`.

        Raises:
            ConfigError: pyarrow is not installed.
        """
        arrow = _library("pyarrow")
        arrays = {name: _plain(values) for name, values in self.flat().items()}
        return arrow.table({name: arrow.array(values) for name, values in arrays.items()})

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with the columns of `flat`.

        Raises:
            ConfigError: pandas is not installed.
        """
        _library("pandas")
        return self.to_arrow().to_pandas()

    def to_polars(self) -> Any:
        """Return a `polars.DataFrame` with the columns of `flat`.

        Raises:
            ConfigError: polars is not installed.
        """
        return _library("polars").from_arrow(self.to_arrow())


def flattened(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return columns of single values from (N,) and (N, ...) arrays."""
    flat: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        if values.ndim == 1:
            flat[FLAT_NAMES.get(name, (name,))[0]] = values
            continue
        single = values.reshape(len(values), int(np.prod(values.shape[1:])))
        names = FLAT_NAMES.get(name) or [f"{name}_{i}" for i in range(single.shape[1])]
        flat |= {part: single[:, i] for i, part in enumerate(names)}
    return flat


def _plain(values: NDArray[Any]) -> Any:
    """Return text as a list: Arrow does not take numpy's."""
    return values.tolist() if values.dtype.kind == "U" else np.ascontiguousarray(values)


def _library(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(f"{name} is not installed: pip install {name}") from error

"""Velocity samples of more scenes than memory holds, in a temporary file."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from typing import overload

import numpy as np

from mottrack.eval.velocity_error import VelocitySamples

# a sample as it lies in the file; the label by its number
_ROW = np.dtype([("error_mps", "f8"), ("true_speed_mps", "f8"), ("label", "i4")])


class SampleFile(Sequence[VelocitySamples]):
    """The samples of each scene, in order: written once, read as often as wanted.

    The file is in `tempfile.gettempdir()` (``$TMPDIR``), 20 bytes a sample, and ends with this
    object.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed with this object
        self._label: dict[str, int] = {}
        self._ends = [0]

    def append(self, samples: VelocitySamples) -> None:
        """Add the samples of the next scene."""
        rows = np.empty(len(samples.error_mps), _ROW)
        rows["error_mps"], rows["true_speed_mps"] = samples.error_mps, samples.true_speed_mps
        names, index = np.unique(samples.label, return_inverse=True)
        numbers = [self._label.setdefault(str(name), len(self._label)) for name in names]
        rows["label"] = np.array(numbers, np.int32)[index]
        self._file.seek(self._ends[-1] * _ROW.itemsize)
        self._file.write(rows.tobytes())
        self._ends.append(self._ends[-1] + len(rows))

    @overload
    def __getitem__(self, scene: int) -> VelocitySamples: ...
    @overload
    def __getitem__(self, scene: slice) -> list[VelocitySamples]: ...
    def __getitem__(self, scene: int | slice) -> VelocitySamples | list[VelocitySamples]:
        if isinstance(scene, slice):
            return [self[k] for k in range(*scene.indices(len(self)))]
        first, end = self._ends[:-1][scene], self._ends[1:][scene]
        self._file.seek(first * _ROW.itemsize)
        rows = np.frombuffer(self._file.read((end - first) * _ROW.itemsize), _ROW)
        return VelocitySamples(
            np.ascontiguousarray(rows["error_mps"]),
            np.ascontiguousarray(rows["true_speed_mps"]),
            np.array([*self._label, ""], np.str_)[rows["label"]],
        )

    def __len__(self) -> int:
        return len(self._ends) - 1

"""Classes seen so far, and the noise of each."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.errors import unknown_name
from mottrack.trackers.kalman import chiu2020, default_noise
from mottrack.trackers.kalman.config import ClassNoise, NoiseConfig
from mottrack.trackers.kalman.noise_model import NoiseRows


def published() -> dict[str, ClassNoise]:
    """The table chiu2020-megvii, per frame."""
    return {
        label: ClassNoise(
            observation=observation,
            initial=observation + chiu2020.INITIAL_RATE[label],
            process=(*chiu2020.PROCESS[label], 0.0, 0.0, 0.0, *chiu2020.PROCESS[label]),
        )
        for label, observation in chiu2020.OBSERVATION.items()
    }


def physical(motion: default_noise.Motion) -> ClassNoise:
    """The noise of one row of the default table."""
    observation, initial, process = default_noise.variances(motion)
    return ClassNoise(
        observation=observation,
        initial=initial,
        process=process,
        along_ratio=motion.along_ratio,
        across_ratio=motion.across_ratio,
        initial_acceleration=motion.acceleration_mps2**2,
        jerk=2.0 * motion.acceleration_mps2**2 / default_noise.CORRELATION_S,
    )


class NoiseTable:
    """Looks the noise of a class up by its index; classes get an index when first seen."""

    def __init__(self, config: NoiseConfig) -> None:
        if config.table not in TABLES:
            raise unknown_name("noise table", config.table, TABLES)
        known = TABLES[config.table]() | config.classes
        self.labels: list[str] = sorted(known)
        self.known = len(self.labels)
        self._unknown = physical(default_noise.UNKNOWN)
        self._rows = [known[label] for label in self.labels]
        self._pack()

    def index(self, label: Texts) -> I64:
        """Index (N,) of each label; an unseen one gets the noise of the unknown class."""
        names = label.tolist()
        for name in sorted(set(names) - self._position.keys()):
            self.labels.append(name)
            self._rows.append(self._unknown)
            self._pack()
        return np.array([self._position[name] for name in names], np.int64)

    def knows(self, label: Texts) -> Mask:
        """Whether each label (N,) has noise of its own."""
        return np.isin(label, self.labels[: self.known])

    @property
    def process(self) -> F64:
        """Process noise (C, 13) of every class, per unit of time."""
        return self._packed.process

    def rows(self, index: I64) -> NoiseRows:
        """Noise of rows of those class indices (N,)."""
        return self._packed.select(index)

    def _pack(self) -> None:
        rows = self._rows
        self._position = {name: k for k, name in enumerate(self.labels)}
        self._packed = NoiseRows(
            observation=np.array([r.observation for r in rows]),
            along_ratio=np.array([r.along_ratio for r in rows]),
            across_ratio=np.array([r.across_ratio for r in rows]),
            initial=np.array([(*r.initial, *[r.initial_acceleration] * 2) for r in rows]),
            process=np.array([(*r.process, *[r.jerk] * 2) for r in rows]),
        )


TABLES = {
    "default": lambda: {k: physical(m) for k, m in default_noise.DEFAULT.items()},
    "chiu2020-megvii": published,
}

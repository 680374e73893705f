"""What mottrack needs of one scene of the tables, as flat arrays that can be stored."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.storage import read_arrays, write_arrays


@dataclass(frozen=True)
class SceneRecord:
    """K key frames, S sweeps of LIDAR_TOP in order of time, B annotated boxes.

    Text is kept as bytes (UTF-8). Poses are quaternions w, x, y, z, then x, y, z in metres.

    sample_token: (K,).
    sweep_stamp_us: (S,). sweep_file: (S,) relative to the root.
    sweep_sample: (S,) the key frame that a sweep is, -1 between key frames.
    world_T_ego: (S, 7) at each sweep. ego_T_lidar: (S, 7).
    box_sample: (B,) key frame of each box, ascending. box_instance: (B,) identity.
    box_category: (B,) official category. box_centre_m: (B, 3) in the world.
    box_size_wlh_m: (B, 3). box_rotation: (B, 4) wxyz. box_points: (B,) LiDAR + radar returns.
    annotated: (1,) whether the tables hold annotations at all (the test split's do not).
    """

    sample_token: NDArray[np.bytes_]
    sweep_stamp_us: I64
    sweep_file: NDArray[np.bytes_]
    sweep_sample: I64
    world_T_ego: F64
    ego_T_lidar: F64
    box_sample: I64
    box_instance: I64
    box_category: NDArray[np.bytes_]
    box_centre_m: F64
    box_size_wlh_m: F64
    box_rotation: F64
    box_points: I64
    annotated: Mask

    def save(self, path: Path) -> None:
        """Store with a checksum."""
        write_arrays(path, {f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, path: Path) -> SceneRecord:
        """Read what `save` wrote.

        Raises:
            ResultError: missing or damaged.

        """
        arrays: dict[str, NDArray[Any]] = read_arrays(path)
        return cls(**arrays)

"""Ground truth from tables in nuScenes format, and a cache of it.

Only the tables and key frames that are needed are read; still a full data set takes half a minute.
A cached file names the tables it was made from with their sizes and times of change, and is made
again when any of them differs. It lies in `$MOTTRACK_CACHE`, else in the user's cache folder; the
data set itself is never written to.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import DataError, ResultError
from mottrack.core.label_velocities import centred_velocities
from mottrack.core.pose import wrap_angle
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.eval.nuscenes.boxes import Bodies, BoxTable, GroundTruth, Racks, Samples
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.cache import cache_folder
from mottrack.formats.collector import collector_paused
from mottrack.formats.nuscenes_classes import CLASS_OF_CATEGORY, RACK_CATEGORY
from mottrack.formats.nuscenes_records import TABLES, SceneRecord, build_records
from mottrack.formats.nuscenes_tables import NuScenesTables, table_path
from mottrack.formats.rigid import quaternion_yaws

FORMAT = "mottrack ground truth 3"
_PARTS = {"samples": Samples, "boxes": BoxTable, "racks": Racks, "bodies": Bodies}


def read_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """Read samples, true boxes and bicycle racks of the named scenes.

    Raises:
        DataError: a table or record is missing or damaged, or no scene has one of the names.
    """
    tables = NuScenesTables(dataroot, version)
    with collector_paused():
        names = _present(tables, scene_names)
        records = list(build_records(tables, names, key_frames_only=True).values())
    counts = [len(record.sample_token) for record in records]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    boxes = _Annotated.of(records, first)
    velocity_mps = np.concatenate([_velocities(record) for record in records])
    table, racks = _split(boxes, rules or Rules())
    return GroundTruth(_samples(records, names, first), table, racks, _bodies(boxes, velocity_mps))


def _present(tables: NuScenesTables, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the wanted scenes in the order of their table; refuse a name that is not there."""
    there = tables.scene_tokens()
    missing = sorted(set(wanted) - there.keys())
    if missing:
        few = ", ".join(missing[:5]) + (f" and {len(missing) - 5} more" if len(missing) > 5 else "")
        raise DataError(tables.path("scene"), "scenes", f"without {few}", "all scenes of the split")
    return tuple(name for name in there if name in set(wanted))


def _samples(records: Sequence[SceneRecord], names: Sequence[str], first: I64) -> Samples:
    """Return the samples of the scenes in order of time, with the vehicle's place at each."""
    return Samples(
        scene_name=np.array(names, np.str_),
        first=first,
        token=np.concatenate([record.sample_token for record in records]).astype(np.str_),
        stamp_us=np.concatenate([record.sample_stamp_us for record in records]),
        ego_xy_m=np.concatenate([_at_samples(record)[:, 4:6] for record in records]),
    )


def _at_samples(record: SceneRecord) -> F64:
    """Return the pose (K, 7) of the vehicle at each sample's LiDAR key frame."""
    keys = np.flatnonzero(record.sweep_sample >= 0)
    at_samples: F64 = record.world_T_ego[keys[np.argsort(record.sweep_sample[keys])]]
    return at_samples


class _Annotated(NamedTuple):
    """The annotations of all scenes, sorted by sample.

    sample, scene, instance: (B,). category: (B,) names. place: (B, 10) translation, size w l h,
    rotation. points: (B,).
    """

    sample: I64
    scene: I64
    instance: I64
    category: NDArray[np.bytes_]
    place: F64
    points: I64

    @classmethod
    def of(cls, records: Sequence[SceneRecord], first: I64) -> "_Annotated":
        """Join the boxes of scenes; `first` (S,) is the row of each scene's first sample."""
        counts = [len(record.box_sample) for record in records]
        return cls(
            sample=np.concatenate(
                [r.box_sample + start for r, start in zip(records, first, strict=False)]
            ),
            scene=np.repeat(np.arange(len(records)), counts),
            instance=np.concatenate([r.box_instance for r in records]),
            category=np.concatenate([r.box_category for r in records]),
            place=np.concatenate(
                [np.hstack([r.box_centre_m, r.box_size_wlh_m, r.box_rotation]) for r in records]
            ),
            points=np.concatenate([r.box_points for r in records]),
        )

    def select(self, index: Mask) -> "_Annotated":
        """Return the rows where `index` (N,) is true."""
        return _Annotated(**{name: values[index] for name, values in self._asdict().items()})


def _split(boxes: _Annotated, rules: Rules) -> tuple[BoxTable, Racks]:
    """Return the true boxes of the classes of the rules, and the racks."""
    label_of = {n.encode(): rules.classes.index(c) for n, c in CLASS_OF_CATEGORY.items()}
    names, number = np.unique(boxes.category, return_inverse=True)
    label = np.array([label_of.get(name, -1) for name in names.tolist()], np.int8)[number]
    racks = boxes.select(names[number] == RACK_CATEGORY.encode())
    counted = label >= 0
    true = boxes.select(counted)
    key = true.scene * (int(true.instance.max(initial=-1)) + 1) + true.instance
    table = BoxTable(
        sample=true.sample,
        track=np.unique(key, return_inverse=True)[1].astype(np.int64),
        label=label[counted],
        centre_m=np.ascontiguousarray(true.place[:, :3]),
        score=np.full(len(true.sample), -1.0),
        num_points=true.points,
    )
    place = racks.place
    return table, Racks(racks.sample, place[:, :3], place[:, 3:6], place[:, 6:])


def _velocities(record: SceneRecord) -> F64:
    """Return the velocity (B, 2) of each box of a scene, at the times of the LiDAR's key frames."""
    stamp_us = record.sweep_stamp_us[record.sweep_sample >= 0]
    stamp_ns = stamp_us[record.box_sample] * 1000
    return centred_velocities(record.box_instance, stamp_ns, record.box_centre_m)


def _bodies(boxes: _Annotated, velocity_mps: F64) -> Bodies:
    names, label = np.unique(boxes.category, return_inverse=True)
    categories = [name.decode() for name in names.tolist()]
    yaw_rad = wrap_angle(quaternion_yaws(boxes.place[:, 6:]))
    return Bodies(
        sample=boxes.sample,
        bev=np.column_stack([boxes.place[:, :2], boxes.place[:, [4, 3]], yaw_rad]),
        velocity_mps=velocity_mps,
        label=label,
        names=np.array([CLASS_OF_CATEGORY.get(name, name) for name in categories], np.str_),
    )


def cached_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """Return what `read_ground_truth` does, from the cache where that is up to date.

    A cache that cannot be read or written is not used.
    """
    rules = rules or Rules()
    source = fingerprint(dataroot, version)
    what = json.dumps([sorted(scene_names), list(rules.classes)])
    path = cache_folder() / f"{_digest(str(dataroot.resolve()), version, what)}.npz"
    stored = _read(path, source)
    if stored is not None:
        return stored
    truth = read_ground_truth(dataroot, version, scene_names, rules)
    _write(path, source, truth)
    return truth


def fingerprint(dataroot: Path, version: str) -> str:
    """Return names, sizes and times of change of the tables, as text."""
    paths = [table_path(dataroot, version, name) for name in TABLES]
    return json.dumps([(p.name, p.stat().st_size, p.stat().st_mtime_ns) for p in paths])


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:24]


def _read(path: Path, source: str) -> GroundTruth | None:
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path, FORMAT)
    except ResultError:
        return None
    if str(arrays.get("source")) != source:
        return None
    parts: dict[str, Any] = {
        prefix: kind(**{f.name: arrays[f"{prefix}.{f.name}"] for f in fields(kind)})
        for prefix, kind in _PARTS.items()
    }
    return GroundTruth(**parts)


def _write(path: Path, source: str, truth: GroundTruth) -> None:
    arrays: dict[str, NDArray[Any]] = {"source": np.array(source)}
    for prefix in _PARTS:
        part = asdict(getattr(truth, prefix))
        arrays |= {f"{prefix}.{name}": value for name, value in part.items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_arrays(path, arrays, FORMAT)
    except OSError:
        return

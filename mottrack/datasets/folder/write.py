"""Write any scenes as logs of a plain folder: docs/own_logs.md."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core import Boxes, InputError, Scene, Sweep
from mottrack.core.storage import write_bytes, write_text
from mottrack.formats.rigid import quaternion_wxyz

_POSES = "stamp_ns,x,y,z,qw,qx,qy,qz"
_BOX = "x,y,z,length,width,height,yaw"
_BOXES = f"stamp_ns,id,label,{_BOX}"
_DETECTIONS = f"stamp_ns,label,score,{_BOX}"


def write_folder(scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
    """Write a folder for each scene; return the names.

    Raises:
        InputError: a label holds a comma or a line's end, which csv without quotes cannot.
    """
    names = []
    for scene in scenes:
        _write_log(scene, root / scene.name)
        names.append(scene.name)
    return tuple(names)


def _write_log(scene: Scene, folder: Path) -> None:
    rows: dict[str, list[str]] = {"poses": [_POSES]}
    for index in range(len(scene)):
        frame = scene.frame(index)
        stamp, pose = frame.stamp_ns, frame.world_T_ego
        rows["poses"].append(_row(stamp, *pose.translation_m, *quaternion_wxyz(pose.rotation)))
        if frame.truth is not None:
            truth = frame.truth.transformed(pose.inverse(), "ego")
            own = rows.setdefault("boxes", [_BOXES])
            own += [
                _row(stamp, truth.id[i], _name(truth.label[i]), *_box(truth, i))
                for i in range(len(truth))
            ]
        if frame.detections is not None:
            found = frame.detections.transformed(pose.inverse(), "ego")
            own = rows.setdefault("detections", [_DETECTIONS])
            own += [
                _row(stamp, _name(found.label[i]), found.score[i], *_box(found, i))
                for i in range(len(found))
            ]
        if scene.has_sweeps:
            write_bytes(folder / "sweeps" / f"{stamp}.npz", _packed(scene.sweep(index)))
    for name, lines in rows.items():
        write_text(folder / f"{name}.csv", "".join(f"{line}\n" for line in lines))


def _row(*values: Any) -> str:
    return ",".join(str(value) for value in values)


def _name(label: Any) -> str:
    text = str(label)
    if "," in text or "\n" in text:
        raise InputError("label", repr(text), "a name without commas")
    return text


def _box(boxes: Boxes, index: int) -> Sequence[float]:
    return [*boxes.centre_m[index], *boxes.size_m[index], boxes.yaw_rad[index]]


def _packed(sweep: Sweep) -> bytes:
    arrays: dict[str, NDArray[Any]] = {"xyz_m": sweep.xyz_m, "reflectance": sweep.reflectance}
    if sweep.time_offset_ns is not None:
        arrays["time_offset_ns"] = sweep.time_offset_ns
    if sweep.ring is not None:
        arrays["ring"] = sweep.ring
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()

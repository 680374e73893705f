"""Convert the pickled results of OpenPCDet or MMDetection3D to an npz that mottrack reads.

    python unpickle_detections.py result.pkl detections.npz
    python unpickle_detections.py results.pkl out.npz --classes car,truck,bus --frames tokens.txt

A pickle can run any program when it is loaded, so mottrack reads none. This script, which you run
yourself on a file of your own, loads it by a list of what may be in it: arrays, tensors and the
boxes of MMDetection3D's LiDAR, as plain numbers. Anything else ends it.
"""

from __future__ import annotations

import argparse
import io
import pickle
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ALLOWED = {
    ("collections", "OrderedDict"),
    ("_codecs", "encode"),  # bytes of arrays, in old protocols
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *(
        (f"numpy.{core}.multiarray", name)
        for core in ("core", "_core")
        for name in ("_reconstruct", "scalar")
    ),
    *((f"numpy.{core}.numeric", "_frombuffer") for core in ("core", "_core")),
    ("torch._utils", "_rebuild_tensor_v2"),
    ("torch", "device"),
}
LIDAR_BOXES = "LiDARInstance3DBoxes"
BOX, BOX_AND_VELOCITY = 7, 9
"""Numbers of a box: x, y, z, length, width, height, heading; and velocity along x and y."""


class LidarBoxes:
    """Stands for MMDetection3D's boxes: what was pickled of them."""

    tensor: Any


def load_storage(data: bytes) -> Any:
    """Load the numbers of a tensor, by torch's own restricted loader."""
    import torch

    return torch.load(io.BytesIO(data), weights_only=True)


class Restricted(pickle.Unpickler):
    """Refuses all names but those listed."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a listed class or function; raise UnpicklingError for any other."""
        if (module, name) == ("torch.storage", "_load_from_bytes"):
            return load_storage
        if module.partition(".")[0] == "mmdet3d" and name == LIDAR_BOXES:
            return LidarBoxes
        if (module, name) in ALLOWED:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"holds {module}.{name}, expected arrays of a detector")


@dataclass
class Frame:
    """What a detector found in one frame: boxes (N, 7 or 9) with z at the centre."""

    name: str
    label: list[str]
    score: np.ndarray
    boxes: np.ndarray


def numbers(value: Any) -> np.ndarray:
    """Return the numbers of an array, a tensor or MMDetection3D's boxes."""
    tensor = value.tensor if isinstance(value, LidarBoxes) else value
    return np.asarray(tensor.numpy() if hasattr(tensor, "numpy") else tensor, np.float64)


def openpcdet(entry: dict[str, Any]) -> Frame:
    """Return a frame of OpenPCDet's list of results."""
    token = (entry.get("metadata") or {}).get("token")
    name = str(entry["frame_id"] if token is None else token)
    labels = [str(label) for label in entry["name"]]
    return Frame(name, labels, numbers(entry["score"]), numbers(entry["boxes_lidar"]))


def mmdet3d(entry: dict[str, Any], classes: list[str]) -> Frame:
    """Return a frame of MMDetection3D's results; `classes` name the numbered labels."""
    found = entry.get("pred_instances_3d") or entry.get("pts_bbox") or entry
    boxes = numbers(found["bboxes_3d" if "bboxes_3d" in found else "boxes_3d"]).copy()
    boxes[:, 2] += boxes[:, 5] / 2.0  # from the bottom to the centre
    labels = [classes[int(label)] for label in numbers(found["labels_3d"])]
    name = str(entry.get("token", entry.get("sample_idx", "")))
    return Frame(name, labels, numbers(found["scores_3d"]), boxes)


def frames_of(content: Any, classes: list[str]) -> Iterator[Frame]:
    """Yield the frames of either list; raise ValueError for anything else."""
    if not isinstance(content, list) or not all(isinstance(entry, dict) for entry in content):
        raise ValueError("expected a list with a dictionary for each frame")
    for entry in content:
        yield openpcdet(entry) if "boxes_lidar" in entry else mmdet3d(entry, classes)


def arrays_of(frames: Iterable[Frame]) -> dict[str, np.ndarray]:
    """Return the frames as the arrays of the npz file that mottrack reads."""
    listed = list(frames)
    boxes = []
    for frame in listed:
        wide = np.full((len(frame.boxes), BOX_AND_VELOCITY), np.nan)
        wide[:, : frame.boxes.shape[1]] = frame.boxes.reshape(len(wide), -1)
        boxes.append(wide)
    together = np.concatenate([np.zeros((0, BOX_AND_VELOCITY)), *boxes])
    has_velocity = np.isfinite(together[:, BOX:]).any()
    return {
        "frames": np.array([frame.name for frame in listed], np.str_),
        "frame": np.repeat(np.arange(len(listed)), [len(frame.boxes) for frame in listed]),
        "label": np.array([name for frame in listed for name in frame.label], np.str_),
        "score": np.concatenate([np.zeros(0), *(frame.score for frame in listed)]),
        "boxes": together if has_velocity else together[:, :BOX],
    }


def main() -> int:
    """Convert the file that the command line names; return the exit code."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("pickle", type=Path)
    parser.add_argument("npz", type=Path)
    parser.add_argument("--classes", default="", help="names of numbered labels: car,truck,...")
    parser.add_argument("--frames", type=Path, help="text file: name of each frame, one a line")
    given = parser.parse_args()
    try:
        with given.pickle.open("rb") as file:
            content = Restricted(file).load()
        frames = list(frames_of(content, given.classes.split(",") if given.classes else []))
    except (
        pickle.UnpicklingError,
        ValueError,
        KeyError,
        IndexError,
        TypeError,
        AttributeError,
        EOFError,
    ) as error:
        return fail(f"{given.pickle}: {type(error).__name__}: {error}")
    if given.frames is not None:
        names = given.frames.read_text().split()
        if len(names) != len(frames):
            return fail(f"{given.frames}: {len(names)} names, expected {len(frames)}")
        for frame, name in zip(frames, names, strict=True):
            frame.name = name
    if len({frame.name for frame in frames}) != len(frames):
        return fail(f"{given.pickle}: frames without a name of their own; give --frames")
    arrays = arrays_of(frames)
    np.savez_compressed(given.npz, **arrays)
    print(f"{given.npz}: {len(arrays['boxes'])} boxes in {len(frames)} frames")
    return 0


def fail(message: str) -> int:
    print(message, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())

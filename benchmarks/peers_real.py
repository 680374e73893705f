"""The Kalman tracker beside its peers of PyPI on real detections: accuracy, every class together.

KITTI's validation sequences with PointRCNN, nuScenes mini with Megvii's and CenterPoint's
detections and the real times of its key frames. `--data` is a folder with `kitti_tracking` and
`nuscenes_mini`; `--out` stores every tracker's tracks, a folder for each set and tracker: scene
results, and KITTI's text files or a submission, which `mottrack folds peers` reads. Figures are
nuScenes' official ones (centres within 2 m), settings those of `benchmarks/peers`, the same for all
sets. Peers need `make peers`.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from _common import arguments, recorded_data, report
from _peers import PEERS, run_peer

from mottrack.core.objects import Objects
from mottrack.core.result import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.kitti.dataset import Kitti
from mottrack.datasets.kitti.results import write_tracks
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.nuscenes.submission import write_submission
from mottrack.eval.evaluation import score
from mottrack.eval.kitti.matching import SPLITS
from mottrack.eval.scores import ScoreConfig
from mottrack.trackers import KalmanTracker

OURS: dict[str, dict[str, Any]] = {
    "mottrack default": {},
    "mottrack published preset": {"preset": "stanford_iprl_tri"},
}


class Drive(NamedTuple):
    """A scene without tracks, and its detections frame by frame."""

    scene: SceneResult
    stream: list[Objects]


def drives_of(dataset: Any, names: tuple[str, ...]) -> Iterator[Drive]:
    """Read scenes of a data set; frames without a detector's output take no part."""
    for name in names:
        scene = dataset.scene(name)
        frames = [scene.frame(k) for k in range(len(scene))]
        frames = [frame for frame in frames if frame.detections is not None]
        empty = SceneResult(
            name,
            FrameTable.of(frames),
            TruthTable.of(frames),
            TrackTable.empty(),
            classes=tuple(scene.classes),
        )
        yield Drive(empty, [frame.detections for frame in frames if frame.detections is not None])


def kitti(root: Path) -> Iterator[Drive]:
    """Validation sequences that have detections."""
    found = {path.stem for path in (root / "detections" / "pointrcnn" / "Car").glob("*.txt")}
    names = tuple(name for name in SPLITS["val"] if name in found)
    return drives_of(Kitti(Kitti.Config(root=root, scenes=names)), names)


def nuscenes(root: Path, detector: str, folder: Path) -> Iterator[Drive]:
    """Scenes with a file of that detector, on tables with the real times of the key frames."""
    copy = folder / detector
    shutil.copytree(root / "v1.0-mini", copy / "v1.0-mini")
    for table in (root / "timed_tables").glob("*.json"):
        (copy / "v1.0-mini" / table.name).chmod(0o644)
        shutil.copyfile(table, copy / "v1.0-mini" / table.name)
    for kind in ("samples", "maps"):
        (copy / kind).symlink_to(root / kind)
    files = {path.stem.rpartition("_")[2]: path for path in _files(root, detector)}
    for name, file in files.items():
        shutil.copyfile(file, copy / f"{name}.json")
        (copy / f"{name}.txt").write_text(f"{name}\n")
        config = NuScenes.Config(
            root=copy,
            version="v1.0-mini",
            split=str(copy / f"{name}.txt"),
            detections=copy / f"{name}.json",
            rate_hz=2,
            follow_links=True,
            cache=False,
        )
        yield from drives_of(NuScenes(config), (name,))


def _files(root: Path, detector: str) -> list[Path]:
    """Files of a detector; the timed one of a scene comes last and replaces the other."""
    return sorted((root / "detections").glob(f"{detector}_*.json"))


def ours(stream: list[Objects], settings: dict[str, Any]) -> TrackTable:
    """Track a scene with one of our presets."""
    tracker = KalmanTracker(KalmanTracker.Config(**settings))
    return TrackTable.of([tracker.step(objects.stamp_ns, objects) for objects in stream])


def tracked(drives: list[Drive], name: str) -> list[SceneResult] | None:
    """Return every scene with the tracks of a tracker; None where it does not run."""
    results = []
    for scene, stream in drives:
        if name in OURS:
            tracks = ours(stream, OURS[name])
        else:
            done = run_peer(name, stream)
            if done is None:
                return None
            tracks = done.tracks
        results.append(replace(scene, tracks=tracks))
    return results


def store(results: list[SceneResult], folder: Path, kitti_root: Path | None) -> None:
    """Store tracks as scene results, and as KITTI's files (with its folder) or a submission."""
    for result in results:
        result.save(folder / f"{result.name}.npz")
        if kitti_root is not None:
            camera = Camera.of_file(kitti_root / "training" / "calib" / f"{result.name}.txt")
            write_tracks(folder / f"{result.name}.txt", result, camera)
    if kitti_root is None:
        write_submission(folder / "submission.json", results)


def figures(results: list[SceneResult]) -> dict[str, float]:
    """Return the figures of all scenes together."""
    scores = score(results, ScoreConfig())
    overall = scores.overall
    named = {"AMOTA": overall.amota, "MOTA": overall.mean_mota, "switches": overall.clear.switches}
    one = {name: scores.classes[name].amota for name in ("car", "pedestrian")}
    return named | {"AMOTP m": overall.amotp_m} | {f"AMOTA {n}": value for n, value in one.items()}


def main() -> None:
    options = arguments(__doc__ or "", data=Path, out=Path)
    data, rows = recorded_data(options.data), []
    with tempfile.TemporaryDirectory() as folder:
        mini = data / "nuscenes_mini"
        sets = {
            "KITTI PointRCNN": kitti(data / "kitti_tracking"),
            "mini Megvii": nuscenes(mini, "megvii", Path(folder)),
            "mini CenterPoint": nuscenes(mini, "centerpoint", Path(folder)),
        }
        for title, found in sets.items():
            drives = [next(found)] if options.quick else list(found)
            for name in (*OURS, *PEERS):
                results = tracked(drives, name)
                if results is None:
                    continue
                rows.append({"set": title, "tracker": name} | figures(results))
                if options.out:
                    camera_root = data / "kitti_tracking" if "KITTI" in title else None
                    store(results, options.out / title / name, camera_root)
    report(rows, options.json)


if __name__ == "__main__":
    main()

"""Recorded official evaluations, unpacked; and a small random problem that needs no files."""

import json
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Racks, Samples

GOLDEN = (
    "base_s11_n3",
    "base_s12_n5",
    "crowd_s15_n2",
    "edge_s14_n3",
    "perfect_s16_n2",
    "ties_s13_n2",
)


@dataclass(frozen=True)
class Golden:
    """One recorded evaluation."""

    name: str
    data: Path
    """Holds v1.0-trainval/ and submission.json."""
    official: Path
    """Holds metrics_summary.json and metrics_details.json."""
    scenes: Path
    """A file with the names of the scenes."""


@pytest.fixture(scope="session")
def golden(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Golden]:
    sets = {}
    for name in GOLDEN:
        official = shared_data / "nuscenes_eval_golden" / name
        folder = tmp_path_factory.mktemp(name)
        with tarfile.open(official / "data.tar.gz") as archive:
            # Python 3.11.3 and older know no filter; the archives are the project's own
            known = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
            archive.extractall(folder, **known)  # noqa: S202
        data = folder / "data"
        rows = json.loads((data / "v1.0-trainval/scene.json").read_text())
        scenes = folder / "scenes.txt"
        scenes.write_text("\n".join(row["name"] for row in rows))
        sets[name] = Golden(name, data, official, scenes)
    return sets


@pytest.fixture(autouse=True)
def private_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MOTTRACK_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def random_problem(
    seed: int, scenes: int = 4, frames: int = 12, classes: int = 7
) -> tuple[GroundTruth, BoxTable]:
    """Tracks at random with gaps, noise, false tracks and changes of identity."""
    rng = np.random.default_rng(seed)
    samples = Samples(
        scene_name=np.array([f"scene-{s:04d}" for s in range(scenes)]),
        first=np.arange(scenes + 1) * frames,
        token=np.array([f"t{i}" for i in range(scenes * frames)]),
        stamp_us=np.arange(scenes * frames) * 500_000 + rng.integers(0, 9000, scenes * frames),
        ego_xy_m=np.zeros((scenes * frames, 2)),
    )
    truth, tracks = [], []
    for number in range(scenes * 9):
        scene, label = number % scenes, int(rng.integers(classes))
        centre = rng.uniform(-30, 30, 3) + np.arange(frames)[:, None] * rng.normal(0, 0.4, 3)
        there = np.flatnonzero(rng.random(frames) < 0.8)
        seen = np.flatnonzero(rng.random(frames) < 0.7)
        identity = number * 3 + np.cumsum(rng.random(frames) < 0.1) % 3
        score = rng.random()
        truth += [(scene * frames + f, number, label, *centre[f], -1.0) for f in there]
        tracks += [
            (scene * frames + f, identity[f], label, *centre[f] + rng.normal(0, 0.6, 3), score)
            for f in seen
        ]
    return GroundTruth(samples, _table(truth, 5), Racks.none()), _table(tracks, -1)


def _table(rows: list[tuple[float, ...]], points: int) -> BoxTable:
    values = np.array(sorted(rows)).reshape(-1, 7)
    return BoxTable(
        sample=values[:, 0].astype(np.int64),
        track=values[:, 1].astype(np.int64),
        label=values[:, 2].astype(np.int8),
        centre_m=np.ascontiguousarray(values[:, 3:6]),
        score=values[:, 6].copy(),
        num_points=np.full(len(values), points),
    )


@pytest.fixture
def make_problem() -> Callable[..., tuple[GroundTruth, BoxTable]]:
    return random_problem

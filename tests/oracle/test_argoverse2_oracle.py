"""Argoverse 2's tracking metrics beside its own package."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mottrack.eval.argoverse2.boxes import Log, LogBoxes
from mottrack.eval.argoverse2.metrics import CategoryMetrics, evaluate
from mottrack.eval.argoverse2.rules import CATEGORIES

FIELDS = {
    "hota": ("HOTA", "HOTA"), "det_a": ("HOTA", "DetA"), "ass_a": ("HOTA", "AssA"),
    "loc_a": ("HOTA", "LocA"), "det_re": ("HOTA", "DetRe"), "ass_pr": ("HOTA", "AssPr"),
    "mota": ("CLEAR", "MOTA"), "motp": ("CLEAR", "MOTP"), "tp": ("CLEAR", "CLR_TP"),
    "fp": ("CLEAR", "CLR_FP"), "fn": ("CLEAR", "CLR_FN"), "ids": ("CLEAR", "IDSW"),
    "frag": ("CLEAR", "Frag"), "mt": ("CLEAR", "MT"), "ml": ("CLEAR", "ML"),
}  # fmt: skip


def made_log(name: str, rng: np.random.Generator) -> Log:
    """Tracks that walk, are lost, change identity and category, meet and lie beyond the range."""
    frames = int(rng.integers(4, 25))
    ego = np.cumsum(rng.normal(0, 1, (frames, 2)), axis=0) + rng.uniform(-1e3, 1e3, 2)
    kinds = rng.choice(len(CATEGORIES), 4, replace=False)
    ties = rng.random() < 0.3
    rows: dict[str, list[tuple[float, ...]]] = {"truth": [], "tracks": []}
    for number in range(int(rng.integers(2, 16))):
        kind = int(rng.choice(kinds))
        start = ego[0] + rng.uniform(-1, 1, 2) * rng.choice([3.0, 20.0, 60.0])
        path = start + np.cumsum(rng.normal(0, 0.4, (frames, 2)), axis=0)
        identity, score = number, float(rng.random())
        for frame in range(frames):
            identity += 100 * int(rng.random() < 0.08)
            if rng.random() < 0.85:
                rows["truth"].append((frame, number, kind, *path[frame], -1.0))
            if rng.random() < 0.8:
                near = path[frame] + rng.normal(0, rng.choice([0.0, 0.3, 1.0]), 2)
                mark = round(score, 1) if ties else float(np.clip(score + rng.normal(0, 0.1), 0, 1))
                other = int(rng.choice(kinds)) if rng.random() < 0.05 else kind
                rows["tracks"].append((frame, identity, other, *near, mark))
    return Log(name, ego, *(boxes(rows[side]) for side in ("truth", "tracks")))


def boxes(rows: list[tuple[float, ...]]) -> LogBoxes:
    table = np.array(sorted(rows, key=lambda row: row[0])).reshape(-1, 6)
    whole = (table[:, k].astype(np.int64) for k in range(3))
    return LogBoxes(*whole, np.ascontiguousarray(table[:, 3:5]), table[:, 5])


def sequence(log: Log, side: LogBoxes) -> list[dict[str, Any]]:
    """One side of a log as the package wants it."""
    frames = []
    for k, place in enumerate(log.ego_xy_m):
        now = side.frame == k
        category = side.category[now]
        frames.append(
            {
                "seq_id": log.name,
                "timestamp_ns": k + 1,
                "ego_translation_m": (*place, 0.0),
                "translation_m": np.column_stack([side.xy_m[now], np.zeros(now.sum())]),
                "size": np.ones((now.sum(), 3)),
                "yaw": np.zeros(now.sum()),
                "velocity_m_per_s": np.zeros((now.sum(), 3)),
                "label": category,
                "name": np.array(CATEGORIES)[category],
                "track_id": side.id[now],
                "score": side.score[now],
            }
        )
    return frames


@pytest.mark.parametrize("seed", range(10))
def test_made_logs_equal_the_package(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from av2.evaluation.tracking import constants
    from av2.evaluation.tracking import eval as package

    assert constants.AV2_CATEGORIES == CATEGORIES
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(seed)
    objective = ("HOTA", "MOTA")[seed % 2]
    logs = [made_log(f"log{k}", rng) for k in range(int(rng.integers(1, 4)))]
    details, best, mean = package.evaluate(
        {log.name: sequence(log, log.tracks) for log in logs},
        {log.name: sequence(log, log.truth) for log in logs},
        objective, 50, None, str(tmp_path / "out/x.json"),
    )  # fmt: skip
    ours = evaluate(logs)
    official = details["TrackEvalDataset"]["TRACKER"]["COMBINED_SEQ"]
    for name, metrics in ours.items():
        figures = metrics.figures()
        key = objective.lower()
        assert figures[key] == pytest.approx(best[name], abs=1e-9), name
        assert figures[f"a{key}"] == pytest.approx(mean[name], abs=1e-9), name
        assert_details(metrics, key, official[name])


def assert_details(metrics: CategoryMetrics, objective: Any, official: dict[str, Any]) -> None:
    found = metrics.at(metrics.best(objective))
    for field, (group, name) in FIELDS.items():
        assert found[field] == pytest.approx(np.mean(official[group][name]), abs=1e-9), field

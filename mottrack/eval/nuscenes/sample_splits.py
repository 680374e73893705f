"""Which split a sample belongs to, for samples that a submission should not have."""

from collections import Counter
from collections.abc import Collection
from pathlib import Path

from mottrack.formats.nuscenes_splits import best_split, splits_of
from mottrack.formats.nuscenes_tables import NuScenesTables, RecordFilter


def describe_samples(dataroot: Path, version: str, tokens: Collection[str]) -> str:
    """Where the samples come from, in words: the official splits that their scenes are in."""
    wanted = set(tokens)
    tables = NuScenesTables(dataroot, version)
    samples = tables.rows("sample", RecordFilter({"token": wanted}))
    scene_of = {row["token"]: row["scene_token"] for row in samples}
    name_of = {row["token"]: row["name"] for row in tables.rows("scene")}
    scenes = Counter(name_of.get(scene, "an unknown scene") for scene in scene_of.values())
    told = []
    if scenes:
        split = best_split(list(scenes))
        parts = [split] if split else list(splits_of(scenes)) or ["no official split"]
        told.append(f"{len(scene_of)} belong to {' and '.join(parts)}")
    if unknown := len(wanted) - len(scene_of):
        told.append(f"{unknown} to no sample of {version}")
    return ", ".join(told)

"""Which point of a cluster moves like the object? Jumps of the reference points, measured.

Clusters of the embedded world are matched to true boxes by overlap. For every object that is seen
in frames k and k + n, the displacement of its cluster's reference point is compared with the true
displacement; the difference over the elapsed time is the velocity error that a tracker would start
from. Frames 0.1 s apart show jitter, frames 1 s apart show the slide of the visible part.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from _common import arguments, report

from mottrack.core import Frame, Objects
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.dataset import SyntheticDataset
from mottrack.geometry.iou import bev_corners, boxes7
from mottrack.objects.clusters import ClustersConfig, ClusterSource, ReferenceConfig

RULES = ("hull_centroid", "rectangle_centre", "nearest_corner", "cell_mean")


def owners(frame: Frame, objects: Objects) -> dict[int, int]:
    """Row of the largest cluster on each true object, by identity."""
    truth = frame.truth
    if truth is None or objects.hull is None:
        return {}
    shapes = shapely.polygons(bev_corners(boxes7(truth.centre_m, truth.size_m, truth.yaw_rad)))
    best: dict[int, tuple[float, int]] = {}
    for row, hull in enumerate(objects.hull):
        polygon = shapely.Polygon(hull)
        near = np.hypot(*(truth.centre_m[:, :2] - hull.mean(axis=0)).T) < 12.0
        found = np.flatnonzero(near)
        shares = shapely.area(shapely.intersection(polygon, shapes[found]))
        for k, shared in zip(found, shares, strict=True):
            identity = int(truth.id[k])
            if shared >= 0.5 * polygon.area and shared > best.get(identity, (0.0, 0))[0]:
                best[identity] = (shared, row)
    return {identity: row for identity, (_, row) in best.items()}


def references(config: SyntheticConfig, rule: str) -> Iterator[list[dict[int, np.ndarray]]]:
    """Per scene and frame: identity -> stamp, reference x, y, true x, y, speed."""
    dataset = SyntheticDataset(config)
    for name in dataset.scene_names:
        source = ClusterSource(ClustersConfig(reference=ReferenceConfig(rule=rule)))
        scene = dataset.scene(name)
        seen = []
        for k in range(len(scene)):
            frame = scene.frame(k)
            objects = source.objects(frame, scene.sweep(k))
            row = {int(i): n for n, i in enumerate(frame.truth.id)}
            seen.append(
                {
                    i: np.array(
                        [
                            frame.stamp_ns * 1e-9,
                            *objects.centre_m[cluster, :2],
                            *frame.truth.centre_m[row[i], :2],
                            np.hypot(*frame.truth.velocity_mps[row[i]]),
                            objects.size_m[cluster, 0],
                        ]
                    )
                    for i, cluster in owners(frame, objects).items()
                }
            )
        yield seen


def errors(seen: list[dict[int, np.ndarray]], step: int) -> np.ndarray:
    """(K, 2) velocity error of the reference and true speed, over pairs `step` frames apart."""
    rows = []
    for early, late in zip(seen, seen[step:], strict=False):
        for identity in early.keys() & late.keys():
            a, b = early[identity], late[identity]
            off = (b[1:3] - a[1:3]) - (b[3:5] - a[3:5])
            rows.append([np.hypot(*off) / (b[0] - a[0]), b[5]])
    return np.array(rows).reshape(-1, 2)


def main() -> None:
    options = arguments(__doc__ or "")
    scenes = 2 if options.quick else 8
    config = SyntheticConfig(scenes=scenes, seed=77, key_hz=10, duration_s=8.0)
    lines = []
    for rule in RULES:
        found = {1: [], 10: []}
        for seen in references(config, rule):
            for step, parts in found.items():
                parts.append(errors(seen, step))
        for step, parts in found.items():
            rows = np.concatenate(parts)
            for kind, chosen in (("standing", rows[:, 1] <= 0.2), ("moving", rows[:, 1] > 0.2)):
                error = rows[chosen, 0]
                lines.append(
                    {
                        "reference": rule,
                        "apart_s": step / 10,
                        "objects": kind,
                        "pairs": int(chosen.sum()),
                        "median_mps": float(np.median(error)),
                        "mean_mps": float(error.mean()),
                        "rms_mps": float(np.sqrt((error**2).mean())),
                        "p95_mps": float(np.percentile(error, 95)),
                    }
                )
    lines.sort(key=lambda line: (line["apart_s"], line["objects"], line["rms_mps"]))
    report(lines, options.json)


if __name__ == "__main__":
    main()

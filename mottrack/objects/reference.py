"""Where a cluster is: its reference point, and how far that may be off."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64
from mottrack.geometry.hulls import HullSet
from mottrack.objects.cluster_points import ClusterPoints

Rule = Literal["hull_centroid", "rectangle_centre", "nearest_corner", "cell_mean"]


class ReferenceConfig(StrictModel):
    """Reference point of a cluster and the covariance of its error."""

    rule: Rule = Field("cell_mean", description="which point of the cluster is its position")
    sampling_m: float = Field(0.03, gt=0, description="standard deviation of a well-seen point")
    spacing_m: float = Field(0.1, ge=0, description="added over the root of the point count")
    extent_share: float = Field(0.02, ge=0, description="added per metre of extent")
    extent_spacing: float = Field(
        0.5, ge=0, description="added per metre of extent over the root of the point count"
    )


def reference_points(rule: Rule, hulls: HullSet, groups: ClusterPoints, sensor_m: F64) -> F64:
    """(G, 2) reference point of each cluster; `sensor_m` (2,) is where the rays start."""
    if rule == "hull_centroid":
        return hulls.centroid_m
    if rule == "cell_mean":
        return groups.cell_mean_m
    centre_m = hulls.rectangle[:, :2]
    return centre_m if rule == "rectangle_centre" else _nearest_corner(hulls.rectangle, sensor_m)


def _nearest_corner(rectangle: F64, sensor_m: F64) -> F64:
    along = np.stack([np.cos(rectangle[:, 4]), np.sin(rectangle[:, 4])], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    towards = sensor_m - rectangle[:, :2]
    a = np.sign(np.einsum("gi,gi->g", along, towards)) * rectangle[:, 2] / 2
    b = np.sign(np.einsum("gi,gi->g", across, towards)) * rectangle[:, 3] / 2
    return np.asarray(rectangle[:, :2] + a[:, None] * along + b[:, None] * across)


def position_covariance(rectangle: F64, num_points: I64, config: ReferenceConfig) -> F64:
    """(G, 2, 2) covariance of the reference point's error.

    Along each side of the smallest rectangle: sampling, and a share of the extent, because the
    visible part of a long cluster slides along it. Fewer points make both worse. The form was
    chosen on jumps measured in the embedded world (benchmarks/cluster_reference.py).
    """
    count = np.maximum(num_points, 1)
    sampling = config.sampling_m**2 + config.spacing_m**2 / count
    share = config.extent_share**2 + config.extent_spacing**2 / count
    variance = sampling[:, None] + share[:, None] * rectangle[:, 2:4] ** 2
    cos, sin = np.cos(rectangle[:, 4]), np.sin(rectangle[:, 4])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    covariance: F64 = (turn * variance[:, None, :]) @ turn.transpose(0, 2, 1)
    return 0.5 * (covariance + covariance.transpose(0, 2, 1))

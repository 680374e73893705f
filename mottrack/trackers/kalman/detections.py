"""What one step observes, as arrays in one fixed order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel
from mottrack.trackers.kalman.config import AssociationConfig, KalmanConfig, NmsConfig
from mottrack.trackers.kalman.noise_model import (
    NoiseRows,
    initial_velocity_covariance,
    position_covariance,
)
from mottrack.trackers.kalman.noise_table import NoiseTable
from mottrack.trackers.kalman.velocity_belief import SMALLEST, density, failure_density


@dataclass(frozen=True, slots=True)
class Detections:
    """N observations o_hat with R_hat = blockdiag(R, R_d)."""

    box: F64
    """(N, 7) x, y, z, yaw, l, w, h."""
    position: F64
    """(N, 2, 2) covariance of x, y."""
    axial: F64
    """(N, 5) variances of z, yaw, l, w, h."""
    velocity: F64
    """(N, 2) in the tracker's unit of time; 0 where not measured."""
    velocity_covariance: F64
    """(N, 2, 2) R_d."""
    no_news: F64
    """(N,) density of such a velocity, times its probability, where the source failed."""
    stray: F64
    """(N,) density of the velocity of an object that no track expects, failures included."""
    surprise_limit: F64
    """(N,) -2 ln lambda: a pair that surprises more is less likely than a stray; else infinite."""
    moving: Mask
    """(N,) whether the velocity was measured."""
    label: I64
    """(N,) index of the class."""
    score: F64
    """(N,)"""
    source: I64
    """(N,) row in the objects handed over."""

    def __len__(self) -> int:
        return len(self.box)

    def select(self, index: NDArray[Any]) -> Detections:
        """The rows that a mask or an index picks."""
        return Detections(*(getattr(self, name)[index] for name in self.__slots__))


def read_detections(
    objects: Objects, config: KalmanConfig, table: NoiseTable, unit_s: float
) -> Detections:
    """Checks, suppresses and orders the objects of a step.

    unit_s is the length of the filter's unit of time in seconds: velocities become metres a unit.
    The order is by class, then from the best score down, so the order of the input is of no
    consequence; the published tracker keeps the order it was given within a class.

    Raises:
        InputError: the objects are not in the world frame.
    """
    if objects.frame != "world":
        raise InputError("frame of objects", repr(objects.frame), "'world'")
    chosen = np.arange(len(objects))
    if config.drop_unknown:
        chosen = chosen[table.knows(objects.label)]
    label = table.index(objects.label[chosen])
    rank = _order(objects, chosen, label, stable=config.yaw == "published")
    chosen, label = chosen[rank], label[rank]
    kept = suppress(objects, chosen, label, config.nms)
    noise = table.rows(label[kept])
    limit = _surprise_limit(config.association, table.labels)[label[kept]]
    return _pack(objects, chosen[kept], (noise, label[kept], limit), (config, unit_s))


def suppress(objects: Objects, chosen: I64, label: I64, config: NmsConfig) -> I64:
    """Positions in `chosen` that survive the score limit and non-maximum suppression."""
    kept = np.arange(len(chosen))
    if not config.enabled:
        return kept
    if config.min_score is not None:
        kept = kept[objects.score[chosen] >= config.min_score]
    # numba behind it: loaded only by those who suppress
    from mottrack.trackers.kalman.nms import non_maximum_suppression

    rows = chosen[kept]
    box = np.hstack([objects.centre_m, objects.size_m, objects.yaw_rad[:, None]])[rows]
    group = label[kept] if config.class_aware else np.zeros(len(kept), np.int64)
    return kept[non_maximum_suppression(box, objects.score[rows], group, config.iou)]


def _order(objects: Objects, chosen: I64, label: I64, *, stable: bool) -> I64:
    if stable:
        return np.asarray(np.argsort(label, kind="stable"))
    score = -objects.score[chosen]
    rank = np.lexsort((score, label))
    tied = (np.diff(score[rank]) == 0) & (np.diff(label[rank]) == 0)
    if not tied.any():
        return rank
    x, y, z = objects.centre_m[chosen].T
    return np.lexsort((z, y, x, score, label))


def _pack(
    objects: Objects,
    rows: I64,
    known: tuple[NoiseRows, I64, F64],
    how: tuple[KalmanConfig, float],
) -> Detections:
    (noise, label, limit), (config, unit_s) = known, how
    yaw = wrap_angle(objects.yaw_rad[rows])
    error_model = error_model_of(objects, config)
    mean, covariance, moving = _velocity(objects, rows, config, error_model.relative)
    velocity, velocity_covariance = mean * unit_s, covariance * unit_s**2
    no_news = stray = np.zeros(len(rows))
    if moving.any():
        gross = config.velocity.gross_mps * unit_s
        no_news = failure_density(velocity, velocity_covariance, error_model, gross)
        unexpected = initial_velocity_covariance(noise, yaw) + velocity_covariance
        stray = np.maximum(no_news + density(velocity, unexpected), SMALLEST)
    return Detections(
        box=np.column_stack([objects.centre_m[rows], yaw, objects.size_m[rows]]),
        position=position_covariance(noise, yaw),
        axial=np.ascontiguousarray(noise.observation[:, 2:]),
        velocity=velocity,
        velocity_covariance=velocity_covariance,
        no_news=no_news,
        stray=stray,
        surprise_limit=limit,
        moving=moving,
        label=label,
        score=objects.score[rows],
        source=rows,
    )


def _surprise_limit(config: AssociationConfig, labels: list[str]) -> F64:
    """-2 ln lambda of each class, (C,)."""
    if config.stray_per_m2 is None:
        return np.full(len(labels), np.inf)
    default = config.stray_per_m2
    density = [config.strays_per_m2.get(name, default) for name in labels]
    return np.asarray(-2.0 * np.log(np.array(density, np.float64)))


def error_model_of(objects: Objects, config: KalmanConfig) -> VelocityErrorModel:
    """How the measured velocities err: as their source says, but for what the settings say."""
    own = NO_OUTLIERS if objects.velocity is None else objects.velocity.error_model
    settings = config.velocity.model_dump(include={"relative", "p_missed_motion", "p_outlier"})
    return replace(own, **{name: value for name, value in settings.items() if value is not None})


def _velocity(
    objects: Objects, rows: I64, config: KalmanConfig, relative: float
) -> tuple[F64, F64, Mask]:
    settings, measured = config.velocity, objects.velocity
    if not settings.use or measured is None:
        n = len(rows)
        return np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, bool)
    covariance = measured.covariance_m2ps2[rows]
    if settings.covariance is not None:
        xx, xy, yy = settings.covariance
        covariance = np.broadcast_to(np.array([[xx, xy], [xy, yy]]), covariance.shape)
    else:
        covariance = covariance + settings.floor_mps**2 * np.eye(2)
    mean = measured.mean_mps[rows]
    if relative > 0:
        covariance = covariance + relative**2 * mean[:, :, None] * mean[:, None, :]
    return mean, covariance, measured.valid[rows]

"""Observations of one step as arrays in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.core.velocity_errors import NO_OUTLIERS, PROBABILITIES, VelocityErrorModel
from mottrack.geometry.iou import uncovered
from mottrack.trackers.association import candidate_pairs
from mottrack.trackers.kalman.config import KalmanConfig, NmsConfig
from mottrack.trackers.kalman.noise import (
    NoiseTable,
    initial_velocity_covariance,
    position_covariance,
)
from mottrack.trackers.kalman.observations import Observation, SeenBoxes
from mottrack.trackers.kalman.standing import velocity_likelihoods
from mottrack.trackers.kalman.state import YAW
from mottrack.trackers.velocity_source.law import Law


@dataclass(frozen=True, slots=True)
class Detections:
    """N observations o_hat with R_hat = blockdiag(R, R_d)."""

    box: F64
    """(N, 7) x, y, z, yaw, l, w, h."""
    xy_covariance: F64
    """(N, 2, 2) covariance of x, y."""
    z_yaw_size_variance: F64
    """(N, 5) variances of z, yaw, l, w, h."""
    velocity: F64
    """(N, 2) in the tracker's unit of time; 0 where not measured."""
    velocity_covariance: F64
    """(N, 2, 2) R_d."""
    likelihood_at_rest: F64
    """(N,) density of the velocity of a missed motion, N(v; 0, R_d)."""
    outlier_likelihood: F64
    """(N,) density of the velocity as a mover's outlier, with its probability (`standing`)."""
    standing_likelihood: F64
    """(N,) density of the velocity of an object that stands, outliers included."""
    clutter_likelihood: F64
    """(N,) density of the velocity of an object without a track, failures included."""
    nll_gate: F64
    """(N,) -2 ln lambda: a pair with a higher -2 ln likelihood is likelier clutter (`clutter`)."""
    evidence: F64
    """(N,) what the score says for a track's object, as log-odds (`score_evidence`)."""
    has_velocity: Mask
    """(N,) whether the velocity was measured."""
    label: I64
    """(N,) index of the class."""
    score: F64
    """(N,)"""
    source: I64
    """(N,) row in the objects handed over."""

    def __len__(self) -> int:
        return len(self.box)

    @property
    def boxes(self) -> SeenBoxes:
        """What was measured of the boxes."""
        return SeenBoxes(self.box, self.xy_covariance, self.z_yaw_size_variance)

    def select(self, index: NDArray[Any]) -> Detections:
        """Return the rows that a mask or an index picks."""
        return Detections(*(getattr(self, name)[index] for name in self.__slots__))


def observations_of(
    objects: Objects,
    config: KalmanConfig,
    table: NoiseTable,
    law: Law,
) -> Detections:
    """Check, suppress and order the objects of a step.

    `law` says how their velocities err, and the filter's unit of time: velocities become metres per
    unit. The order is by class, then by descending score, so that results do not depend on the
    order of the input; the published tracker keeps the input's order within a class.
    """
    rows = np.arange(len(objects))
    if config.drop_unknown:
        rows = rows[table.knows(objects.label)]
    label = table.index(objects.label[rows])
    order = _order(objects, rows, label, stable=config.yaw == "published")
    rows, label = rows[order], label[order]
    boxes = _boxes(objects, rows)
    if config.nms.enabled:
        kept = _suppressed(boxes, objects.score[rows], label, config.nms)
        rows, label, boxes = rows[kept], label[kept], boxes[kept]
    box = np.ascontiguousarray(boxes[:, [0, 1, 2, 6, 3, 4, 5]])
    yaw = box[:, YAW] = wrap_angle(box[:, YAW])
    noise = table.rows(label)
    measured = _velocities(objects, rows, config, law.model.relative)
    per_unit = law.unit_s / law.gain
    velocity, covariance = measured.mean * per_unit, measured.covariance * law.scale * per_unit**2
    likelihood = np.zeros((4, len(rows)))
    if measured.valid.any():
        unexpected, seen = (
            initial_velocity_covariance(noise, yaw),
            Observation(velocity, covariance),
        )
        at_rest = config.association.new_at_rest if config.standing.use else 0.0
        likelihood = velocity_likelihoods(seen, unexpected, at_rest, law.failures)
    return Detections(
        box=box,
        xy_covariance=position_covariance(noise, yaw),
        z_yaw_size_variance=np.ascontiguousarray(noise.observation[:, 2:]),
        velocity=velocity,
        velocity_covariance=covariance,
        likelihood_at_rest=likelihood[0],
        outlier_likelihood=likelihood[1],
        standing_likelihood=likelihood[2],
        clutter_likelihood=likelihood[3],
        nll_gate=np.full(len(rows), np.inf),
        evidence=np.zeros(len(rows)),
        has_velocity=measured.valid,
        label=label,
        score=objects.score[rows],
        source=rows,
    )


def _order(objects: Objects, rows: I64, label: I64, *, stable: bool) -> I64:
    if stable:
        return np.argsort(label, kind="stable")
    score = -objects.score[rows]
    order = np.lexsort((score, label))
    ranked, ranked_label = score[order], label[order]
    tied = (ranked[1:] == ranked[:-1]) & (ranked_label[1:] == ranked_label[:-1])
    if not tied.any():
        return order
    x, y, z = objects.centre_m[rows].T
    return np.lexsort((z, y, x, score, label))


def _boxes(objects: Objects, rows: I64) -> F64:
    """Return the rows (n, 7) of x, y, z, l, w, h, yaw of those objects."""
    boxes = np.empty((len(rows), 7))
    boxes[:, :3], boxes[:, 3:6] = objects.centre_m[rows], objects.size_m[rows]
    boxes[:, 6] = objects.yaw_rad[rows]
    return boxes


def _suppressed(boxes: F64, score: F64, label: I64, config: NmsConfig) -> I64:
    """Return the rows that survive the score limit and non-maximum suppression."""
    kept = np.arange(len(boxes))
    if config.min_score is not None:
        kept = kept[score >= config.min_score]
    group = label[kept] if config.class_aware else np.zeros(len(kept), np.int64)
    return kept[non_maximum_suppression(boxes[kept], score[kept], group, config.iou)]


def non_maximum_suppression(boxes: F64, score: F64, group: I64, iou: float) -> I64:
    """Return the rows (sorted) of the boxes that no better box of their group covers.

    From the highest score down (ties: the earlier row), a box is dropped if its BeV IoU with a box
    that stays is above `iou`.

    Args:
        boxes: rows (N, 7) of x, y, z, l, w, h, yaw.
        score: (N,)
        group: (N,) only boxes of one group suppress each other.
        iou: threshold in [0, 1].
    """
    order = np.argsort(-score, kind="stable")
    ranked = boxes[order]
    diagonal = np.hypot(ranked[:, 3], ranked[:, 4])
    reach = 0.5 * (diagonal + diagonal.max(initial=0.0))
    better, worse = candidate_pairs(ranked[:, :2], ranked[:, :2], reach, (group[order],) * 2)
    later = better < worse
    return np.sort(order[uncovered(ranked, (better[later], worse[later]), iou)])


def error_model_of(objects: Objects, config: KalmanConfig) -> VelocityErrorModel:
    """Return how the measured velocities err: the source's model, overridden by the settings."""
    own = NO_OUTLIERS if objects.velocity is None else objects.velocity.error_model
    settings = {
        name: getattr(config.velocity, name) for name in ("relative", "persistence", *PROBABILITIES)
    }
    given = {name: value for name, value in settings.items() if value is not None}
    return replace(own, **given) if given else own


class _Velocities(NamedTuple):
    """Measured velocities of N detections in m/s."""

    mean: F64
    covariance: F64
    valid: Mask


def _velocities(objects: Objects, rows: I64, config: KalmanConfig, relative: float) -> _Velocities:
    settings, measured = config.velocity, objects.velocity
    if not settings.use or measured is None:
        n = len(rows)
        return _Velocities(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, bool))
    covariance = measured.covariance_m2ps2[rows]
    known = dict(measured.error_model.class_variances) | settings.class_variance
    if settings.noise == "class" and known:
        variance = _by_class(objects.label[rows], known)
        covariance = variance[:, None, None] * np.eye(2)
    elif settings.covariance is not None:
        xx, xy, yy = settings.covariance
        covariance = np.broadcast_to(np.array([[xx, xy], [xy, yy]]), covariance.shape)
    else:
        covariance = covariance + settings.floor_mps**2 * np.eye(2)
    mean = measured.mean_mps[rows]
    if relative > 0:
        covariance = covariance + relative**2 * mean[:, :, None] * mean[:, None, :]
    return _Velocities(mean, covariance, measured.valid[rows])


def _by_class(label: Texts, known: dict[str, float]) -> F64:
    """Return the variance (N,) of each label; classes without one of their own get the largest."""
    others = known.get("all", max(known.values()))
    return np.array([known.get(name, others) for name in label.tolist()], np.float64)

"""Built-in noise parameters by class: of LiDAR detectors on the road, and as published.

`default` is in SI units: standard deviations of detected boxes about the truth, and the motion of
road users. Speeds and accelerations are physical (what such objects do on roads), not fitted to a
scene. `chiu2020-megvii` holds the covariances that Chiu et al. (2020, arXiv 2001.05673) estimated
from MEGVII detections on the nuScenes training set, per frame of 0.5 s. Their yaw differences were
not wrapped, which is why yaw hardly counts there.
"""

from __future__ import annotations

from typing import NamedTuple

from mottrack.trackers.kalman.config import ClassNoise

CORRELATION_S = 1.0
"""Accelerations and turns last for about a second: q = 2 sigma^2 tau is their spectral density."""
WANDER_M2PS = 0.01
"""Random walk of the observed centre on the body: it shifts as the visible side changes."""
WANDER_RAD2PS = 0.01
"""The same of the observed heading."""
SIZE_M2PS = 0.0025
"""Random walk of the observed size, for the same reason."""
_VERTICAL_SPEED_MPS = 0.5
"""Standard deviation of d_z: a road of 5 % gradient driven at 10 m/s."""
_VERTICAL_Q_M2PS3 = 0.05
"""Spectral density of vertical acceleration: gradients change over tens of metres."""


class ClassSigmas(NamedTuple):
    """Standard deviations of one class: of its detected box, and of its motion."""

    centre_m: float
    z_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    box_height_m: float
    speed_mps: float
    acceleration_mps2: float
    yaw_rate_rps: float
    lateral_ratio: float = 0.3
    """Speed across the heading over that along it."""
    slip_rad: float = 0.06
    """Heading about the course: among true boxes over 1 m/s of nuScenes mini .03 to .1 rad."""

    def noise(self) -> ClassNoise:
        """Return R, P0 and Q per second of the class."""
        box = (self.centre_m, self.centre_m, self.z_m, self.yaw_rad)
        observation = tuple(s**2 for s in (*box, self.length_m, self.width_m, self.box_height_m))
        speed, turn = self.speed_mps**2, self.yaw_rate_rps**2
        rates = (speed, speed, _VERTICAL_SPEED_MPS**2, turn)
        push = 2.0 * self.acceleration_mps2**2 * CORRELATION_S
        rate_growth = (push, push, _VERTICAL_Q_M2PS3, 2.0 * turn / CORRELATION_S)
        wander = (WANDER_M2PS, WANDER_M2PS, WANDER_M2PS, WANDER_RAD2PS)
        return ClassNoise(
            observation=observation,
            initial=observation + rates,
            process=(*wander, SIZE_M2PS, SIZE_M2PS, SIZE_M2PS, *rate_growth),
            lateral_ratio=self.lateral_ratio,
            slip_rad=self.slip_rad,
        )


# arguments in the order of `ClassSigmas`; where the numbers come from is said at the top
DEFAULT: dict[str, ClassSigmas] = {
    "car": ClassSigmas(0.25, 0.15, 0.20, 0.25, 0.12, 0.12, 12.0, 1.5, 0.3, lateral_ratio=0.15),
    "truck": ClassSigmas(0.40, 0.25, 0.20, 0.70, 0.20, 0.25, 12.0, 1.2, 0.2, lateral_ratio=0.15),
    "bus": ClassSigmas(0.45, 0.25, 0.15, 0.80, 0.20, 0.25, 12.0, 1.2, 0.2, lateral_ratio=0.15),
    "trailer": ClassSigmas(0.50, 0.30, 0.25, 1.00, 0.25, 0.30, 10.0, 1.2, 0.2, lateral_ratio=0.15),
    "motorcycle": ClassSigmas(0.22, 0.15, 0.30, 0.18, 0.10, 0.12, 5.0, 1.8, 0.5),
    "bicycle": ClassSigmas(0.22, 0.15, 0.30, 0.18, 0.10, 0.12, 3.0, 1.2, 0.5),
    "cyclist": ClassSigmas(0.22, 0.15, 0.30, 0.18, 0.10, 0.12, 3.0, 1.2, 0.5),
    "pedestrian": ClassSigmas(0.18, 0.15, 0.50, 0.15, 0.12, 0.14, 1.3, 0.6, 0.8, 1.0, slip_rad=0.2),
}

UNKNOWN = ClassSigmas(0.30, 0.20, 0.30, 0.40, 0.20, 0.20, 5.0, 1.5, 0.4, 1.0, slip_rad=0.2).noise()
"""Any other class: a road user of which nothing is known."""

_OBSERVATION: dict[str, tuple[float, ...]] = {
    "bicycle": (0.05390982, 0.05039431, 0.01863044, 1.29464435, 0.02713823, 0.01169572, 0.01295084),
    "bus": (0.17546469, 0.13818929, 0.05947248, 0.1979503, 0.78867322, 0.05507407, 0.06684149),
    "car": (0.08900372, 0.09412005, 0.03265469, 1.00535696, 0.10912802, 0.02359175, 0.02455134),
    "motorcycle": (
        0.04052819,
        0.0398904,
        0.01511711,
        1.06442726,
        0.03291016,
        0.00957574,
        0.0111605,
    ),
    "pedestrian": (0.03855275, 0.0377111, 0.02482115, 2.0751833, 0.02286483, 0.0136347, 0.0203149),
    "trailer": (0.23228021, 0.22229261, 0.07006275, 1.05163481, 1.37451601, 0.06354783, 0.10500918),
    "truck": (0.14862173, 0.1444596, 0.05417157, 0.73122169, 0.69387238, 0.05484365, 0.07748085),
}
"""R, and the first seven of P0: variances of x, y, z, yaw, l, w, h in m^2 and rad^2."""

_INITIAL_RATE: dict[str, tuple[float, ...]] = {
    "bicycle": (0.04560422, 0.04097244, 0.01725477, 1.21635902),
    "bus": (0.13263319, 0.11508148, 0.05033665, 0.22529652),
    "car": (0.08120681, 0.08224643, 0.02266425, 0.99492726),
    "motorcycle": (0.0437039, 0.04327734, 0.01465631, 1.30414345),
    "pedestrian": (0.04237008, 0.04092393, 0.01482923, 2.0059979),
    "trailer": (0.2138643, 0.19625241, 0.05231335, 0.97082174),
    "truck": (0.10683797, 0.10248689, 0.0378078, 0.76188901),
}
"""The last four of P0: d_x, d_y, d_z, d_yaw in (m/frame)^2 and (rad/frame)^2."""

_PROCESS: dict[str, tuple[float, ...]] = {
    "bicycle": (0.0198881347, 0.0136552276, 0.00510175742, 0.133430252),
    "bus": (0.117729925, 0.0884659079, 0.011761644, 0.209050032),
    "car": (0.158918523, 0.124935318, 0.00535573165, 0.0922800791),
    "motorcycle": (0.032364759, 0.0386650974, 0.00547421635, 0.234967407),
    "pedestrian": (0.0334814566, 0.0247354921, 0.00594592529, 0.424962535),
    "trailer": (0.0419985099, 0.0368661552, 0.011941505, 0.056316624),
    "truck": (0.0945275998, 0.0945620374, 0.00838061721, 0.14168046),
}
"""Q per frame of x, y, z, yaw, and the same numbers of their rates; none on the size."""


def _published() -> dict[str, ClassNoise]:
    return {
        label: ClassNoise(
            observation=observation,
            initial=observation + _INITIAL_RATE[label],
            process=(*_PROCESS[label], 0.0, 0.0, 0.0, *_PROCESS[label]),
        )
        for label, observation in _OBSERVATION.items()
    }


TABLES: dict[str, dict[str, ClassNoise]] = {
    "default": {label: sigmas.noise() for label, sigmas in DEFAULT.items()},
    "chiu2020-megvii": _published(),
}

"""The figures that the paper prints (arXiv 2008.01179), and which of them it draws claims from.

Transcribed from the LaTeX source of the paper; percentages of Table III are divided by 100.
"""

from __future__ import annotations

from dataclasses import dataclass

from mottrack.eval.paired import MetricKey
from mottrack.eval.velocity_error import CATEGORIES

NONE, ICP, OGM, PILLARFLOW, DOGMA = (
    "zero",
    "icp_one_start",
    "binary_ogm_raw",
    "pillarflow_raw",
    "dogma",
)
LABELS = {
    NONE: "none",
    ICP: "ICP + Det.",
    OGM: "Binary OGM",
    PILLARFLOW: "PillarFlow",
    DOGMA: "DOGMa",
    "icp": "ICP + Det., six starts",
    "cluster_icp": "cluster ICP",
    "binary_ogm": "Binary OGM, refined",
    "pillarflow": "PillarFlow, refined",
    "ground_truth": "true flow",
    "spynet": "SpyNet",
    "flownet": "FlowNet2",
    "pwc": "PWCNet",
    "with_ground": "PillarFlow with ground",
}
"""Variant of a study to its name in a table."""


@dataclass(frozen=True)
class Published:
    """One table of the paper."""

    number: str
    title: str
    source: str
    study: str
    """Which of our runs it is held against."""
    figures: tuple[tuple[str, MetricKey], ...]
    """Heading and our figure of each of its columns."""
    values: dict[str, tuple[float | None, ...]]
    """Variant to what the paper prints; None where it prints nothing."""
    extra: tuple[str, ...] = ()
    """Rows of ours that the paper has not."""
    pairs: tuple[tuple[str, str], ...] = ()
    """Which rows the paper compares: the first against the second."""
    note: str = ""
    upright: bool = True
    """Methods in rows; else in columns."""
    digits: int = 3
    """Behind the point, in print."""

    @property
    def variants(self) -> tuple[str, ...]:
        """All rows, the paper's first."""
        return (*self.values, *self.extra)

    def printed(self, variant: str, column: int) -> float | None:
        """What the paper prints."""
        return self.values[variant][column] if variant in self.values else None


def _flow(row: str, metric: str, unit: str) -> MetricKey:
    return MetricKey("flow", row, metric, unit)


_RMSE = "RMSE of the flow"
TABLE_I = Published(
    "I",
    "Flow error against baselines",
    "Table I, nuScenes",
    "flow",
    (
        ("RMSE dynamic (m)", _flow("dynamic", _RMSE, "m")),
        ("RMSE static (m)", _flow("static", _RMSE, "m")),
        ("RMSE average (m)", _flow("all", _RMSE, "m")),
        ("AAE (rad)", _flow("all", "AAE", "rad")),
    ),
    {
        ICP: (2.818, None, None, 0.216),
        OGM: (1.316, 0.113, 0.247, 0.091),
        PILLARFLOW: (1.127, 0.110, 0.207, 0.108),
    },
    ("icp", "binary_ogm", "pillarflow"),
    ((PILLARFLOW, ICP), (OGM, ICP), (PILLARFLOW, OGM)),
    "Metres between two sweeps: the paper's are further apart than our 0.1 s, so compare rows, not "
    "levels. A cell that a source did not measure counts as zero flow; the paper prints no static "
    "error of ICP and its average is that of dynamic cells (left out here). On TRI-cuboid the "
    "paper's AAE is lower for PillarFlow than for Binary OGM (0.087, 0.098), on nuScenes it is "
    "higher. Refined rows add the toolkit's stages after the network.",
)
TABLE_II = Published(
    "II",
    "Flow error of other networks, and with the ground kept",
    "Table II, nuScenes",
    "flow",
    (
        ("RMSE (m)", _flow("all", _RMSE, "m")),
        ("AAE (rad)", _flow("all", "AAE", "rad")),
    ),
    {
        "spynet": (0.327, 0.122),
        "flownet": (0.320, 0.072),
        PILLARFLOW: (0.207, 0.087),
        "with_ground": (0.246, 0.079),
    },
    (),
    ((PILLARFLOW, "spynet"), (PILLARFLOW, "flownet"), (PILLARFLOW, "with_ground")),
    "The paper prints 0.087 for PillarFlow's AAE here and 0.108 in Table I.",
)
TABLE_III = Published(
    "III",
    "Tracking without and with measured velocities",
    "Table III, nuScenes validation",
    "tracking",
    (
        ("AMOTA", MetricKey("tracking", "all", "AMOTA", lower_is_better=False)),
        ("AMOTP (m)", MetricKey("tracking", "all", "AMOTP", "m")),
        ("MOTA", MetricKey("tracking", "all", "MOTA", lower_is_better=False)),
        ("MOTP (m)", MetricKey("tracking", "all", "MOTP", "m")),
    ),
    {
        NONE: (0.561, 0.800, 0.483, 0.379),
        OGM: (0.565, 0.796, 0.486, 0.382),
        PILLARFLOW: (0.566, 0.797, 0.492, 0.382),
    },
    ("icp", "pillarflow", "ground_truth"),
    ((PILLARFLOW, NONE), (OGM, NONE), (PILLARFLOW, OGM)),
    "Official nuScenes rules, means over classes. AMOTP and MOTP are distances, so less is better; "
    "the paper prints its highest ones in bold and reads the fall of AMOTP as a loss.",
)
_MEAN = {
    NONE: (0.839, 0.772, 0.861, 0.566, 2.396),
    DOGMA: (0.848, 0.523, 0.512, 0.570, 2.371),
    PILLARFLOW: (0.480, 0.641, 0.059, 0.666, 2.036),
}
_WORST = {
    NONE: (3.993, 3.411, 3.826, 2.117, 15.188),
    DOGMA: (3.803, 1.621, 1.796, 1.709, 11.490),
    PILLARFLOW: (2.322, 1.446, 0.151, 1.560, 7.468),
}
TABLE_IV = Published(
    "IV",
    "Track velocity error of class-agnostic clusters, m/s",
    "Table IV, 43 snippets of 10 s",
    "velocity",
    tuple(
        (f"{row}, {metric}", MetricKey("velocity", row, metric, "m/s"))
        for metric in ("mean", "worst 5 %")
        for row in CATEGORIES
    ),
    {variant: (*_MEAN[variant], *_WORST[variant]) for variant in _MEAN},
    ("cluster_icp", "pillarflow", "ground_truth"),
    ((PILLARFLOW, NONE), (PILLARFLOW, DOGMA), (DOGMA, NONE)),
    "The paper's '95 % largest' is read as the mean of the worst 5 %. A track is held against the "
    "box that it overlaps at the stamp, or within one turn of the LiDAR along the box's motion.",
    upright=False,
)
TABLE_V = Published(
    "V",
    "Runtime of the flow",
    "Table V, in-house platform with an RTX 6000, TensorRT, half precision",
    "runtime",
    (
        ("mean (ms)", MetricKey("runtime", "flow", "mean", "ms")),
        ("variance (ms²)", MetricKey("runtime", "flow", "variance", "ms²")),
    ),
    {ICP: (20.0, 5.0), DOGMA: (45.0, 1.0), PILLARFLOW: (23.0, 0.1)},
    ("icp", "pillarflow"),
    ((PILLARFLOW, DOGMA), (PILLARFLOW, ICP)),
    "The paper's network and DOGMa run on a GPU, ours on one CPU thread unless the machine has a "
    "GPU. It prints its variance in ms.",
    upright=False,
    digits=1,
)
TABLES = (TABLE_I, TABLE_II, TABLE_III, TABLE_IV, TABLE_V)

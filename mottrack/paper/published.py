"""Values that the paper prints (arXiv 2008.01179) and the comparisons that it makes of them.

Transcribed from the LaTeX source; percentages of Table III are divided by 100.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mottrack.eval.paired import MetricKey
from mottrack.eval.sceneflow.figures import key_of
from mottrack.eval.velocity_error import CATEGORIES

NONE, ICP, OGM = "zero", "icp_one_start", "binary_ogm_raw"
PILLARFLOW, DOGMA = "pillarflow_raw", "dogma"
EQUAL, EQUAL_OGM = "pwc", "binary_ogm_equal"
"""PillarFlow's network and the binary one, trained by the one recipe of Tables I and II."""
LABELS = {
    NONE: "none",
    ICP: "ICP + Det.",
    OGM: "Binary OGM",
    PILLARFLOW: "PillarFlow",
    DOGMA: "DOGMa",
    "icp": "ICP + Det., six starts",
    "dogma_printed": "DOGMa as printed",
    "cluster_icp": "cluster ICP",
    "binary_ogm": "Binary OGM, refined",
    "pillarflow": "PillarFlow, refined",
    "ground_truth": "true flow",
    "spynet": "SpyNet",
    "flownet": "FlowNet2",
    EQUAL: "PillarFlow, equal training",
    EQUAL_OGM: "Binary OGM, equal training",
    "with_ground": "PillarFlow with ground",
}
"""Variant of a study to its name in a table."""


class TableColumn(NamedTuple):
    """A column of a table."""

    heading: str
    key: MetricKey
    """The metric of ours that corresponds to it."""


@dataclass(frozen=True)
class Published:
    """One table of the paper."""

    number: str
    title: str
    source: str
    study: str
    """The study that reproduces it."""
    columns: tuple[TableColumn, ...]
    values: dict[str, tuple[float | None, ...]]
    """Variant to what the paper prints in each column; None where it prints nothing."""
    pairs: tuple[tuple[str, str], ...]
    """Rows that the paper compares: the first against the second."""
    extra: tuple[str, ...] = ()
    """Rows of ours that the paper does not have."""
    note: str = ""
    methods_in_rows: bool = True
    """Whether methods are rows of the printed table; else they are columns."""
    digits: int = 3
    """Printed digits after the decimal point."""

    @property
    def heading(self) -> str:
        """Number and title; a table without a row of the paper has no number of it."""
        return f"Table {self.number}: {self.title}" if self.values else self.title

    @property
    def variants(self) -> tuple[str, ...]:
        """All rows, the paper's first."""
        return (*self.values, *self.extra)

    def printed(self, variant: str, column: int) -> float | None:
        """Return what the paper prints for a variant; None where it prints nothing."""
        return self.values[variant][column] if variant in self.values else None


def _flow(heading: str, row: str, metric: str, unit: str) -> TableColumn:
    return TableColumn(heading, MetricKey("flow", row, metric, unit))


def _tracking(heading: str, metric: str, unit: str = "", *, lower: bool = True) -> TableColumn:
    return TableColumn(heading, MetricKey("tracking", "all", metric, unit, lower))


_RMSE = "RMSE of the flow"
TABLE_I = Published(
    number="I",
    title="Flow error against baselines",
    source="Table I, nuScenes",
    study="flow",
    columns=(
        _flow("RMSE dynamic (m)", "movable", _RMSE, "m"),
        _flow("RMSE moving (m)", "dynamic", _RMSE, "m"),
        _flow("RMSE static (m)", "static", _RMSE, "m"),
        _flow("RMSE average (m)", "all", _RMSE, "m"),
        _flow("AAE (rad)", "all", "AAE", "rad"),
    ),
    values={
        ICP: (2.818, None, None, None, 0.216),
        EQUAL_OGM: (1.316, None, 0.113, 0.247, 0.091),
        EQUAL: (1.127, None, 0.110, 0.207, 0.108),
    },
    pairs=((EQUAL, ICP), (EQUAL_OGM, ICP), (EQUAL, EQUAL_OGM)),
    extra=("icp", OGM, PILLARFLOW, "binary_ogm", "pillarflow"),
    note="Equal training: one recipe for all networks (make train-equal); the other rows have the "
    "default weights, trained for longer. Displacement in metres between two sweeps: those of the "
    "paper are further apart than our 0.1 s, so compare the order. A cell that a source did not "
    "measure counts as zero flow; the paper prints no static error of ICP, and its average is "
    "that of dynamic cells (omitted here). On TRI-cuboid the paper's AAE is lower for PillarFlow "
    "than for Binary OGM (0.087, 0.098), on nuScenes it is higher. Refined rows add the stages of "
    "this toolkit after the network.",
)
TABLE_II = Published(
    number="II",
    title="Flow error of other networks, and with ground points",
    source="Table II, nuScenes",
    study="flow",
    columns=(
        _flow("RMSE (m)", "all", _RMSE, "m"),
        _flow("AAE (rad)", "all", "AAE", "rad"),
    ),
    values={
        "spynet": (0.327, 0.122),
        "flownet": (0.320, 0.072),
        EQUAL: (0.207, 0.087),
        "with_ground": (0.246, 0.079),
    },
    pairs=((EQUAL, "spynet"), (EQUAL, "flownet"), (EQUAL, "with_ground")),
    extra=(PILLARFLOW,),
    note="Training as in Table I. The paper prints 0.087 for the AAE of PillarFlow here and 0.108 "
    "in Table I.",
)
TABLE_III = Published(
    number="III",
    title="Tracking without and with measured velocities",
    source="Table III, nuScenes validation",
    study="tracking",
    columns=(
        _tracking("AMOTA", "AMOTA", lower=False),
        _tracking("AMOTP (m)", "AMOTP", "m"),
        _tracking("MOTA", "MOTA", lower=False),
        _tracking("MOTP (m)", "MOTP", "m"),
    ),
    values={
        NONE: (0.561, 0.800, 0.483, 0.379),
        OGM: (0.565, 0.796, 0.486, 0.382),
        PILLARFLOW: (0.566, 0.797, 0.492, 0.382),
    },
    pairs=((PILLARFLOW, NONE), (OGM, NONE), (PILLARFLOW, OGM)),
    extra=("icp", "pillarflow", "ground_truth"),
    note="Official nuScenes rules, means over classes. AMOTP and MOTP are distances, so lower is "
    "better; the paper prints the highest in bold and reads the decrease of AMOTP as a loss.",
)
TABLE_IV = Published(
    number="IV",
    title="Track velocity error of class-agnostic clusters, m/s",
    source="Table IV, 43 snippets of 10 s",
    study="velocity",
    columns=tuple(
        TableColumn(f"{row}, {metric}", MetricKey("velocity", row, metric, "m/s"))
        for metric in ("mean", "worst 5 %")
        for row in CATEGORIES
    ),
    values={  # the first five columns are means, the last five tail means
        NONE: (0.839, 0.772, 0.861, 0.566, 2.396, 3.993, 3.411, 3.826, 2.117, 15.188),
        DOGMA: (0.848, 0.523, 0.512, 0.570, 2.371, 3.803, 1.621, 1.796, 1.709, 11.490),
        PILLARFLOW: (0.480, 0.641, 0.059, 0.666, 2.036, 2.322, 1.446, 0.151, 1.560, 7.468),
    },
    pairs=((PILLARFLOW, NONE), (PILLARFLOW, DOGMA), (DOGMA, NONE)),
    extra=("cluster_icp", "pillarflow", "ground_truth"),
    note="The paper's '95 % largest' is read as the mean of the worst 5 %. A track is compared "
    "with the box that it overlaps at the stamp, or within one LiDAR revolution along the motion "
    "of the box.",
    methods_in_rows=False,
)
TABLE_III_DEFAULT = Published(
    number="III_default",
    title="Tracking with the default tracker, the scenes of Table III",
    source="not in the paper",
    study="tracking_default",
    columns=TABLE_III.columns,
    values={},
    pairs=(),
    extra=(NONE, "pillarflow", "ground_truth"),
)
TABLE_IV_PRINTED = Published(
    number="IV_printed",
    title="Track velocity error, section V as printed, the scenes of Table IV, m/s",
    source="not in the paper",
    study="velocity_printed",
    columns=TABLE_IV.columns,
    values={},
    pairs=(),
    extra=(NONE, "dogma_printed", PILLARFLOW, "ground_truth"),
    note="Table IV above has our default tracker, as the claims have.",
    methods_in_rows=False,
)
TABLE_V = Published(
    number="V",
    title="Runtime of the flow",
    source="Table V, in-house platform with an RTX 6000, TensorRT, half precision",
    study="runtime",
    columns=(
        TableColumn("mean (ms)", MetricKey("runtime", "flow", "mean", "ms")),
        TableColumn("variance (ms²)", MetricKey("runtime", "flow", "variance", "ms²")),
    ),
    values={ICP: (20.0, 5.0), DOGMA: (45.0, 1.0), PILLARFLOW: (23.0, 0.1)},
    pairs=((PILLARFLOW, DOGMA), (PILLARFLOW, ICP)),
    extra=("icp", "pillarflow"),
    note="Network and DOGMa of the paper run on a GPU, ours on one CPU thread unless the machine "
    "has a GPU. The paper prints the variance in ms.",
    methods_in_rows=False,
    digits=1,
)
SCENE_FLOW = Published(
    number="scene_flow",
    title="Scene flow, in the figures of Argoverse 2's challenges",
    source="not in the paper",
    study="flow",
    columns=(
        TableColumn("three-way EPE (m)", key_of("official", "EPE 3-Way Average")),
        TableColumn("bucketed, dynamic", key_of("bucketed", "mean dynamic")),
        TableColumn("bucketed, static (m)", key_of("bucketed", "mean static")),
        TableColumn("strict accuracy", key_of("official", "Accuracy Strict/Foreground/Dynamic")),
        TableColumn("relaxed accuracy", key_of("official", "Accuracy Relax/Foreground/Dynamic")),
        TableColumn("angle error (rad)", key_of("official", "Angle Error/Foreground/Dynamic")),
    ),
    values={},
    pairs=(),
    extra=(ICP, OGM, PILLARFLOW, "icp", "binary_ogm", "pillarflow", "ground_truth"),
    note="Point by point, 0.1 s; the bucketed dynamic error is a share of the speed, 1 for an "
    "estimate of rest. Accuracies and angle are those of moving objects.",
)
"""A table of ours, whose first row the others are compared with."""
TABLES = (
    TABLE_I,
    TABLE_II,
    SCENE_FLOW,
    TABLE_III,
    TABLE_III_DEFAULT,
    TABLE_IV,
    TABLE_IV_PRINTED,
    TABLE_V,
)

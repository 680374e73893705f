"""Object sources (detections or clusters of points), and object velocities from a flow field."""

from mottrack.core.interfaces import TableEntry

OBJECTS: dict[str, TableEntry] = {
    "detections": TableEntry(
        "mottrack.objects.detections:DetectionSource", "The detections of the data set."
    ),
    "clusters": TableEntry(
        "mottrack.objects.clusters:ClusterSource",
        "Clusters of points above the ground; each tile of a long wall is a cluster of its own.",
    ),
}
"""Name in a configuration to its class."""

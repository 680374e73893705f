"""Objects: from detections or clusters of points, with a velocity each from the flow field."""

OBJECTS: dict[str, str] = {
    "detections": "mottrack.objects.detections:DetectionSource",
    "clusters": "mottrack.objects.clusters:ClusterSource",
}
"""Name in a configuration to ``module:Class``; imported when asked for."""

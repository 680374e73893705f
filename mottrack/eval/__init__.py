"""Scores of tracks and flow against truth, by the official rules and by the paper's."""

if __name__ != "mottrack.eval":
    raise ImportError("import mottrack.eval; the bare name would make every class twice")

METRICS: dict[str, str] = {
    "scores": "mottrack.eval.scores:score",
    "velocity_error": "mottrack.eval.velocity_error:velocity_table",
    "flow_error": "mottrack.eval.flow_error:flow_table",
    "clear": "mottrack.eval.clear:clear_counts",
    "identity": "mottrack.eval.identity:identity_counts",
    "hota": "mottrack.eval.hota:hota_counts",
    "nuscenes": "mottrack.eval.nuscenes.summary:evaluate",
    "bootstrap": "mottrack.eval.nuscenes.bootstrap:intervals",
    "anatomy": "mottrack.eval.nuscenes.anatomy_report:classify_errors",
    "kitti": "mottrack.eval.kitti.levels:evaluate",
    "mot": "mottrack.eval.mot.evaluation:score_boxes",
}
"""Metric name to `module:function`; nothing is imported until it is asked for."""

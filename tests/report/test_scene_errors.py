import numpy as np

from mottrack.core import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scene_scores
from mottrack.report.analysis import Analysis
from mottrack.report.scene_errors import NO_ID, scene_errors
from mottrack.runs.comparison import Comparison


def boxes(rows: list[tuple[int, int, float]]) -> dict[str, np.ndarray]:
    """Return box columns for rows of frame, identity and x."""
    n = len(rows)
    return {
        "frame": np.array([r[0] for r in rows], np.int64),
        "id": np.array([r[1] for r in rows], np.int64),
        "label": np.full(n, "car"),
        "centre_m": np.array([(r[2], 0.0, 0.0) for r in rows]).reshape(-1, 3),
        "size_m": np.tile([4.0, 2.0, 1.5], (n, 1)),
        "yaw_rad": np.zeros(n),
        "velocity_mps": np.zeros((n, 2)),
    }


def scene() -> SceneResult:
    """Return a scene with every type of miss, a switch and a false positive."""
    truth = boxes([(f, 1, 10.0) for f in range(7)] + [(2, 2, 30.0)])
    tracks = boxes([(1, 7, 10.0), (2, 7, 10.0), (4, 9, 10.0), (5, 9, 10.0), (5, 8, -20.0)])
    frames = FrameTable(
        np.arange(7) * 10**8,
        np.array([str(f) for f in range(7)]),
        np.tile(np.eye(4), (7, 1, 1)),
        np.tile([-np.pi, np.pi], (7, 1)),
        np.ones(7, np.bool_),
    )
    return SceneResult(
        "s",
        frames,
        TruthTable(**truth, num_points=np.full(8, 5), interpolated=np.zeros(8, bool)),
        TrackTable(
            **tracks,
            velocity_covariance_m2ps2=np.tile(np.eye(2), (5, 1, 1)),
            score=np.ones(5),
            observed=np.ones(5, bool),
            hull_corners=np.zeros(5, np.int64),
        ),
    )


def test_every_error_has_its_type() -> None:
    found = scene_errors(scene(), [ScoreFilter("car")], ScoreConfig())
    assert [(e.frame, e.kind, e.detail, e.truth_id, e.track_id) for e in found] == [
        (0, "miss", "late start", 1, NO_ID),
        (2, "miss", "never found", 2, NO_ID),
        (3, "miss", "gap", 1, NO_ID),
        (4, "switch", "", 1, 9),
        (5, "false positive", "", NO_ID, 8),
        (6, "miss", "early end", 1, NO_ID),
    ]
    assert found[-2].xy_m == (-20.0, 0.0)


def test_the_listed_errors_sum_to_the_counts_of_the_table(comparison: Comparison) -> None:
    for run in comparison.runs:
        filters, config = Analysis.of(run).classes.filters, run.experiment.settings.scores
        results = [run.folder.load(scene) for scene in run.report.finished]
        listed = [e.kind for result in results for e in scene_errors(result, filters, config)]
        table = run.scores.overall.clear
        assert (listed.count("miss"), listed.count("false positive"), listed.count("switch")) == (
            table.misses,
            table.false_positives,
            table.switches,
        )
        assert table.misses == sum(
            scene_scores(result, part, config).clear.misses
            for result in results
            for part in filters
        )

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scene_scores
from mottrack.report.analysis import Analysis
from mottrack.report.scene_errors import NOBODY, scene_errors
from mottrack.runs.comparison import Comparison


def boxes(rows: list[tuple[int, int, float]]) -> dict[str, np.ndarray]:
    """Rows of frame, identity and place along x."""
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
    """An object found late and lost early, with a gap and a switch; one never found; a ghost."""
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


def test_every_error_is_named_by_its_kind() -> None:
    found = scene_errors(scene(), [ScoreFilter("car")], ScoreConfig())
    assert [(e.frame, e.kind, e.detail, e.truth_id, e.track_id) for e in found] == [
        (0, "miss", "late start", 1, NOBODY),
        (2, "miss", "never found", 2, NOBODY),
        (3, "miss", "gap", 1, NOBODY),
        (4, "switch", "", 1, 9),
        (5, "false positive", "", NOBODY, 8),
        (6, "miss", "early end", 1, NOBODY),
    ]
    assert found[-2].xy_m == (-20.0, 0.0)


def test_the_listed_errors_add_up_to_the_table(comparison: Comparison) -> None:
    for run in comparison.runs:
        cuts, config = Analysis.of(run).cuts, run.experiment.settings.scores
        results = [run.folder.load(scene) for scene in run.report.finished]
        listed = [e.kind for result in results for e in scene_errors(result, cuts, config)]
        table = run.scores.overall.clear
        assert (listed.count("miss"), listed.count("false positive"), listed.count("switch")) == (
            table.misses,
            table.false_positives,
            table.switches,
        )
        assert table.misses == sum(
            scene_scores(result, cut, config).clear.misses for result in results for cut in cuts
        )

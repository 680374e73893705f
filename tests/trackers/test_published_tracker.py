"""The stanford_iprl_tri preset against stored output of the published tracker's prototype."""

from pathlib import Path

import numpy as np

from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker

from .conftest import CLASSES, STEP_NS

REFERENCE = Path(__file__).parent / "published_reference.npz"
"""Made by `make_published_reference.py`; the detections are in single precision, by class."""


def test_same_ids_states_and_scores_to_1e_9() -> None:
    with np.load(REFERENCE, allow_pickle=False) as stored:
        data = {name: stored[name] for name in stored.files}
    tracker = KalmanTracker(KalmanTracker.Config(preset="stanford_iprl_tri"))
    for frame in range(int(data["frame"].max()) + 1):
        rows = data["frame"] == frame
        box = data["box"][rows].astype(float)
        objects = Objects(
            stamp_ns=frame * STEP_NS,
            frame="world",
            centre_m=box[:, :3],
            size_m=box[:, 4:],
            yaw_rad=box[:, 3],
            label=np.array(CLASSES)[data["label"][rows]],
            score=data["score"][rows].astype(float),
        )
        tracks = tracker.step(objects.stamp_ns, objects)
        expected = data["track_frame"] == frame
        order, wanted = np.argsort(tracks.id), np.argsort(data["track_id"][expected])
        # the original counts identities from 0
        np.testing.assert_array_equal(tracks.id[order] - 1, data["track_id"][expected][wanted])
        state = data["track_state"][expected][wanted]
        np.testing.assert_allclose(tracks.state[order, :7], state, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(tracks.score[order], data["track_score"][expected][wanted])
    assert len(data["track_id"]) > 500

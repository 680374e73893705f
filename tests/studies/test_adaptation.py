"""The network tuned to logs without labels: labels, split, judgement, resuming."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mottrack.core.errors import ConfigError
from mottrack.core.velocity_errors import NO_OUTLIERS
from mottrack.eval.label_free import ERROR, MOVING
from mottrack.eval.paired import PairedDifference
from mottrack.experiment.experiment import load_experiments
from mottrack.flow.cluster_icp import ClusterIcpFlow
from mottrack.flow.pillarflow.training.examples import ExampleBuilder
from mottrack.flow.pillarflow.training.validation import Scores
from mottrack.flow.shipped_errors import shipped_errors, weights_errors, write_beside
from mottrack.studies.adaptation.adapt import adapt, why_not
from mottrack.studies.adaptation.config import AdaptConfig, Files
from mottrack.studies.adaptation.judgement import FIELDS, Verdict
from mottrack.studies.adaptation.pseudo_labels import LABEL_GRID, agreement, label_frame
from mottrack.studies.adaptation.stretches import split_logs
from tests.flow.conftest import Street

SPEED_MPS = 6.0


@dataclass(frozen=True)
class StreetLog:
    """A street as a recorded scene, and as a data set of that scene alone."""

    street: Street
    frames: int
    name: str = "street"
    classes: tuple[str, ...] = ("car",)
    has_sweeps: bool = True

    def __len__(self):
        return self.frames

    def frame(self, index):
        return replace(self.street.frame(index), truth=None)

    def sweep(self, index):
        return self.street.sweep(index)

    def scene(self, _name):
        return self


def test_three_of_four_estimates_make_a_label_and_two_do_not():
    unknown = [np.nan, np.nan]
    cells = [
        [[5.0, 0.0], [5.2, 0.1], [4.9, 0.0], [0.0, 0.0]],
        [[0.0, 0.0], [0.0, 0.0], [2.0, 0.0], [2.0, 0.0]],
        [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], unknown],
        [[3.0, 0.0], [3.0, 0.0], unknown, unknown],
    ]
    mean, agreed = agreement(np.array(cells).swapaxes(0, 1))
    assert agreed.tolist() == [True, False, True, False]
    np.testing.assert_allclose(mean[0], [5.03, 0.03], atol=0.01)


def test_labels_of_a_street_are_its_true_motion_or_masked():
    log = StreetLog(Street(speed_mps=SPEED_MPS, ego_mps=3.0), 6)
    found = label_frame(log, 4, ClusterIcpFlow(grid=LABEL_GRID))
    assert label_frame(log, 1, ClusterIcpFlow(grid=LABEL_GRID)) is None
    labels, current = found.pair.labels, found.pair.current
    rows, cols, inside = LABEL_GRID.cells(current.xyz_m)
    raised = inside & (current.xyz_m[:, 2] > 0.4)
    on_car = raised & log.street.car_cells(4, LABEL_GRID)[rows, cols]
    unknown = labels.current_object == labels.current_object.max()
    moving = np.hypot(*labels.velocity_mps.T) > 0.5
    assert (moving | unknown)[on_car].all()
    assert moving[on_car].mean() > 0.8
    assert not moving[raised & ~on_car].any()
    np.testing.assert_allclose(labels.velocity_mps[moving].mean(axis=0), [SPEED_MPS, 0.0], atol=0.4)
    example = ExampleBuilder(remove_ground=True).build(found.pair)
    assert (example.previous_object >= 0).any()
    assert found.coverage.moving > 5
    assert found.coverage.static > 20


def test_stretches_train_or_judge_and_never_both():
    split = split_logs(StreetLog(Street(), 40), ["street"], 0.3)
    frames = [set(s.frames) for s in (*split.training, *split.held_out)]
    assert len(set.union(*frames)) == sum(map(len, frames)) > 36
    assert 2 <= len(split.held_out) < len(split.training)
    with pytest.raises(ConfigError, match="5 frames"):
        split_logs(StreetLog(Street(), 5), ["street"], 0.3)
    with pytest.raises(ConfigError, match="no sweeps"):
        split_logs(replace(StreetLog(Street(), 40), has_sweeps=False), ["street"], 0.3)


def difference(before, after, half):
    return PairedDifference(ERROR, before, after, after - before - half, after - before + half, 8)


@pytest.mark.parametrize(
    ("alone", "staged", "after_mps", "word"),
    [
        ((0.5, 0.4, 0.05), (0.2, 0.2, 0.1), 2.0, ""),
        ((0.5, 0.4, 0.2), (0.2, 0.2, 0.1), 2.0, "not significantly better"),
        ((0.5, 0.6, 0.05), (0.2, 0.2, 0.1), 2.0, "not significantly better"),
        ((0.5, 0.4, 0.05), (0.2, 0.3, 0.05), 2.0, "significantly worse"),
        ((0.5, 0.4, 0.05), (0.2, 0.2, 0.1), 2.2, "forgets"),
    ],
)
def test_weights_are_kept_only_where_better_and_nowhere_worse(alone, staged, after_mps, word):
    rows = [(difference(*numbers),) for numbers in (alone, staged)]
    verdict = Verdict(8, dict(zip(FIELDS, rows, strict=True)))
    scores = Scores(2.0, 0.6, 0.7, 0.5, 0.02, 0.4, 0.9)
    reason = why_not(verdict, scores, replace(scores, dynamic_rmse=after_mps), AdaptConfig())
    assert word in reason
    assert bool(word) == bool(reason)


def test_a_gain_at_rest_does_not_pay_for_a_loss_of_what_moves():
    worse = replace(difference(0.16, 0.17, 0.004), key=MOVING)
    rows = [(difference(0.5, 0.4, 0.05), worse), (difference(0.2, 0.2, 0.1),)]
    verdict = Verdict(8, dict(zip(FIELDS, rows, strict=True)))
    scores = Scores(2.0, 0.6, 0.7, 0.5, 0.02, 0.4, 0.9)
    assert "moving residual" in why_not(verdict, scores, scores, AdaptConfig())


def test_adapted_weights_have_the_error_model_of_those_before(tmp_path):
    weights = tmp_path / "own.safetensors"
    assert weights_errors(str(weights), refined=True) == NO_OUTLIERS
    write_beside(weights, "base")
    assert weights_errors(str(weights), refined=True) == shipped_errors("base") != NO_OUTLIERS
    assert weights_errors(str(weights), refined=False) == shipped_errors("base_raw")


class Steps:
    """Remembers the training steps."""

    def __init__(self):
        self.taken = []

    def part(self, title, done, total):
        pass

    def training(self, progress, _steps):
        self.taken.append(progress.step)


def test_an_adaptation_resumes_judges_and_reports(tmp_path):
    (experiment,) = load_experiments(
        "demo", ["flow=pillarflow", "dataset.scenes=1", "dataset.duration_s=2.4"]
    )
    config = AdaptConfig(
        weights="small", frames=4, steps=1, batch_size=1, synthetic_pairs=1, validation_pairs=2
    )
    first, second = Steps(), Steps()
    out = tmp_path / "own.safetensors"
    adapt(experiment, config, out, first)
    outcome = adapt(experiment, config.model_copy(update={"steps": 2}), out, second)
    assert (first.taken, second.taken) == ([1], [2])
    assert Files(out).report.exists()
    assert out.exists() == outcome.kept == Files(out).card.exists()
    assert {row.key for row in outcome.verdict.fields[FIELDS[0]]} >= {ERROR}
    with pytest.raises(ConfigError, match="other logs or settings"):
        adapt(experiment, config.model_copy(update={"seed": 5}), out, Steps())

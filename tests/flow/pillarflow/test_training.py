"""The trainer learns and resumes to the identical curve; examples, crops and shards are sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from mottrack.core.errors import ConfigError, DataError
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoders import PRESETS, preset
from mottrack.flow.pillarflow.network import PillarFlowNet
from mottrack.flow.pillarflow.pillars import CellGrid
from mottrack.flow.pillarflow.training.augmentation import scale_objects
from mottrack.flow.pillarflow.training.batches import (
    NO_ROTATION,
    CropConfig,
    Sampler,
    cut,
    random_rotation,
)
from mottrack.flow.pillarflow.training.config import (
    AugmentationConfig,
    LossConfig,
    ScheduleConfig,
    TrainConfig,
)
from mottrack.flow.pillarflow.training.examples import EXAMPLE_GRID, Example
from mottrack.flow.pillarflow.training.losses import bucket_mean
from mottrack.flow.pillarflow.training.shards import Shards, write_shard
from mottrack.flow.pillarflow.training.trainer import RankInfo, Trainer, finish, network_config
from mottrack.flow.pillarflow.weights_file import load_weights, widen

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
ALONE = RankInfo(0, 1, torch.device("cpu"))
Boxes = Callable[..., Example]


def _config(steps: int) -> TrainConfig:
    return TrainConfig(
        network="small",
        steps=steps,
        batch_size=2,
        log_every=1,
        validate_every=1000,
        save_every=3,
        threads=1,
        schedule=ScheduleConfig(warm_up_steps=2),
    )


def test_resuming_gives_the_identical_loss_curve(tmp_path: Path, box_example: Boxes) -> None:
    examples = [box_example(seed) for seed in range(4)]
    whole = Trainer(_config(6), ALONE, _made(tmp_path / "whole"))
    whole.fit(examples, examples[:1], lambda _: None)

    class StoppedError(Exception):
        pass

    def stop(progress: object) -> None:
        if progress.step == 4:
            raise StoppedError

    halves = _made(tmp_path / "halves")
    with pytest.raises(StoppedError):
        Trainer(_config(6), ALONE, halves).fit(examples, examples[:1], stop)
    again = Trainer(_config(6), ALONE, halves)
    assert again.progress.step == 3
    again.fit(examples, examples[:1], lambda _: None)
    assert again.progress.history == whole.progress.history


def test_loss_falls_and_weights_can_be_read_back(tmp_path: Path, box_example: Boxes) -> None:
    examples = [box_example(seed) for seed in range(4)]
    trainer = Trainer(_config(20), ALONE, _made(tmp_path / "run"))
    progress = trainer.fit(examples, examples[:2], lambda _: None)
    losses = [point["loss"] for point in progress.history if "loss" in point]
    assert np.mean(losses[-5:]) < np.mean(losses[:5])
    finish(trainer, examples[:2])
    weights = load_weights(tmp_path / "run" / "weights.safetensors")
    assert weights.network.config == trainer.network.config
    assert (tmp_path / "run" / "curve.png").stat().st_size > 0


def test_a_loss_that_is_not_finite_ends_the_run(tmp_path: Path, box_example: Boxes) -> None:
    """Otherwise hours would be spent on weights that cannot be read back."""
    trainer = Trainer(_config(2), ALONE, _made(tmp_path / "run"))
    with torch.no_grad():
        next(trainer.network.parameters()).fill_(float("nan"))
    with pytest.raises(ConfigError, match=r"loss is nan at step 0 .* precision fp32"):
        trainer.fit([box_example(0)], [box_example(0)], lambda _: None)


def test_a_run_begins_from_weights_of_fewer_inputs_with_their_output(
    tmp_path: Path, box_example: Boxes
) -> None:
    """Older sweeps and three-dimensional visibility change nothing before the first step."""
    tiny = NetworkConfig(pillar_channels=8, pyramid_channels=(8, 8, 8), estimator_channels=(8, 8))
    more = tiny.model_copy(update={"sight": True, "older_ages_s": (0.3, 0.5)})
    trained, wider = PillarFlowNet(tiny).eval(), PillarFlowNet(more).eval()
    widen(tmp_path / "tiny", trained, wider)
    sampler = Sampler([box_example(0)], 0.5, CropConfig(), AugmentationConfig(), seed=7)
    pair = sampler.batch(0, 2).pair
    assert pair.ratio.shape == (2, 2)
    with torch.no_grad():
        one, two = trained(pair), wider(pair)
    assert (one.motions[-1] - two.motions[-1]).abs().max() < 1e-6
    assert (one.factor - two.factor).abs().max() < 1e-4
    with pytest.raises(DataError, match=r"tiny: .*expected shape"):
        widen(tmp_path / "tiny", wider, PillarFlowNet(tiny))
    with pytest.raises(DataError, match="network"):
        widen(tmp_path / "tiny", trained, PillarFlowNet(PRESETS["spynet"]))


def test_one_recipe_gives_every_network_the_same_inputs() -> None:
    recipe = yaml.safe_load((CONFIGS / "train_equal.yaml").read_text(encoding="utf-8"))
    for name in ("base", "binary_ogm", "spynet", "flownet"):
        config = network_config(TrainConfig.model_validate(recipe | {"network": name}))
        assert (config.visibility, config.sight, config.older) == (True, False, 0)
        kept = preset(name).model_dump(exclude=set(recipe["network_settings"]))
        assert config.model_dump(exclude=set(recipe["network_settings"])) == kept
    with pytest.raises(ConfigError, match="network_settings: sigth"):
        network_config(TrainConfig(network_settings={"sigth": True}))


def test_a_torn_checkpoint_is_named(tmp_path: Path, box_example: Boxes) -> None:
    out = _made(tmp_path / "run")
    trainer = Trainer(_config(1), ALONE, out)
    trainer.fit([box_example(0)], [box_example(0)], lambda _: None)
    file = out / "checkpoint.safetensors"
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(DataError, match=r"checkpoint\.safetensors"):
        Trainer(_config(2), ALONE, out)


def test_shards_return_the_examples(tmp_path: Path, box_example: Boxes) -> None:
    full = [box_example(seed, boxes=5 + seed) for seed in range(3)]
    nothing_older = [e.select_older(np.zeros(len(e.older), bool)) for e in full[1:]]
    examples = [full[0], *nothing_older]  # the last of a shard, and all of one
    assert len(full[0].older)
    write_shard(tmp_path / "a.safetensors", examples[:2])
    write_shard(tmp_path / "b.safetensors", examples[2:])
    shards = Shards(tmp_path)
    assert len(shards) == 3
    for read, written in zip(shards, examples, strict=True):
        for field in fields(Example):
            wanted, got = getattr(written, field.name), getattr(read, field.name)
            assert np.shape(wanted) == np.shape(got)
            assert np.allclose(np.asarray(wanted, float), np.asarray(got, float), 0, 2.1e-3)
    with pytest.raises(DataError, match="absent"):
        Shards(_made(tmp_path / "none"))


def test_scaling_keeps_the_motion_rigid(box_example: Boxes) -> None:
    """Matching points of a scaled box still differ by the motion that the label says."""
    example = box_example(0)
    xy_m = example.current[:, :2] - example.motion_m
    older = [
        np.column_stack((example.current[:, :2] - k * example.motion_m, example.current[:, 2:]))
        for k in (3, 5)
    ]
    same = replace(
        example,
        previous=np.column_stack((xy_m, example.current[:, 2:])),
        older=np.concatenate(older),
    )
    scaled = scale_objects(same, 0.3, np.random.default_rng(0))
    away = scaled.current[:, :2] - scaled.previous[:, :2] - scaled.motion_m
    assert np.abs(away).max() < 1e-5
    for slot, k in enumerate((3, 5)):
        then = scaled.older[scaled.older_slot == slot]
        away = scaled.current[:, :2] - then[:, :2] - k * scaled.motion_m
        assert np.abs(away).max() < 1e-4
    assert np.abs(scaled.current - same.current).max() > 0.1


def test_a_rotated_crop_rotates_the_motion_with_the_points(box_example: Boxes) -> None:
    example, crop = box_example(0), CropConfig()
    cells = CellGrid(-64.0, -64.0, 0.5, 256, 256)
    rotation = random_rotation(np.random.default_rng(5))
    one = cut(example, cells, NO_ROTATION, crop)
    two = cut(example, cells, rotation, crop)
    speeds = [np.sort(np.linalg.norm(c.motion_m, axis=0).ravel())[-40:] for c in (one, two)]
    assert np.allclose(speeds[0][-1], speeds[1][-1], atol=1e-4)
    point = example.current[np.argmax(np.linalg.norm(example.motion_m, axis=1))]
    xy = rotation @ point[:2]
    row, column = int((xy[1] + 64) // 0.5), int((xy[0] + 64) // 0.5)
    fastest = example.motion_m[np.argmax(np.linalg.norm(example.motion_m, axis=1))]
    assert np.allclose(two.motion_m[:, row, column], rotation @ fastest, atol=0.3)


def test_objects_that_cannot_be_matched_are_masked(box_example: Boxes) -> None:
    example = box_example(0)
    kept = example.previous_object != 1
    unmatched = example.select(kept, np.ones(len(example.current), bool))
    grid = EXAMPLE_GRID
    cells = CellGrid(grid.x_min_m, grid.y_min_m, grid.cell_m, 200, 200)
    crop = cut(unmatched, cells, NO_ROTATION, CropConfig())
    point = example.current[example.current_object == 1][0]
    row, column = int((point[1] + 50) // 0.5), int((point[0] + 50) // 0.5)
    assert crop.mask[0, row, column] == 0.0
    assert crop.mask.sum() > 100


def test_a_batch_depends_on_seed_step_and_row_alone(box_example: Boxes) -> None:
    examples = [box_example(seed) for seed in range(3)]
    sampler = Sampler(examples, 0.5, CropConfig(), AugmentationConfig(), seed=7)
    pair, single = sampler.batch(5, 2), sampler.batch(5, 1, first=1)
    assert torch.equal(pair.target.motion_m[1:], single.target.motion_m)
    assert torch.equal(sampler.batch(5, 2).pair.shares, pair.pair.shares)


def test_buckets_weigh_each_speed_alike() -> None:
    error = torch.tensor([[[1.0, 1.0, 1.0, 1.0, 2.0, 4.0]]])
    speed = torch.tensor([[[0.0, 0.0, 0.0, 0.0, 1.0, 9.0]]])
    mask = torch.ones(1, 1, 6, dtype=torch.bool)
    config = LossConfig(static_weight=1.5)
    assert float(bucket_mean(error, speed, mask, config)) == pytest.approx(1.5 + 2.0 + 4.0)


def test_schedules() -> None:
    flat = ScheduleConfig(kind="trapezoid", warm_up_steps=10, decay_share=0.5)
    assert flat.factor(0, 100) == pytest.approx(0.1)
    assert flat.factor(40, 100) == 1.0
    assert flat.factor(75, 100) == pytest.approx(0.5)
    paper = ScheduleConfig(kind="exponential", warm_up_steps=0)
    assert paper.factor(35, 100) == pytest.approx(0.9**3)
    cosine = ScheduleConfig(kind="cosine", warm_up_steps=0)
    assert cosine.factor(100, 100) == pytest.approx(0.0)


def _made(directory: Path) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    return directory

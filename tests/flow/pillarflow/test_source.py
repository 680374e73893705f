"""PillarFlow as a flow source: its contract, its bad input, its export."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from mottrack.core.errors import DataError, InputError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow.pillarflow.calibration import Calibration
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoders import DECODERS, PRESETS
from mottrack.flow.pillarflow.engine import CpuEngine, EngineInput, OlderPoints
from mottrack.flow.pillarflow.export import export_onnx
from mottrack.flow.pillarflow.layers import Context
from mottrack.flow.pillarflow.network import NetworkInput, PillarFlowNet, PointBatch
from mottrack.flow.pillarflow.pillars import CellGrid, describe
from mottrack.flow.pillarflow.source import (
    SHIPPED,
    BinaryOgmConfig,
    BinaryOgmFlow,
    PillarFlow,
    PillarFlowConfig,
)
from mottrack.flow.pillarflow.training.examples import BoxedSweep, labels_from_tracks
from mottrack.flow.pillarflow.weights_file import Weights, load_weights, save_weights

GRID = BevGrid(-16.0, 16.0, -12.0, 12.0, 0.25)
TINY = NetworkConfig(pillar_channels=8, pyramid_channels=(8, 8, 8), estimator_channels=(8, 8))
TINY_HISTORY = TINY.model_copy(update={"sight": True, "older_ages_s": (0.3, 0.5)})


def _weights(config: NetworkConfig = TINY, seed: int = 0) -> Weights:
    """Random weights with statistics, and motions worth comparing."""
    torch.manual_seed(seed)
    network = PillarFlowNet(config)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.running_mean, -0.2, 0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
        if isinstance(module, torch.nn.Conv2d) and module.out_channels == 2:
            torch.nn.init.normal_(module.weight, std=0.05)
    return Weights(network.eval(), Calibration(1.3), True)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "weights.safetensors"
    save_weights(path, _weights())
    return path


def _sweep(stamp_ns: int, seed: int = 0, count: int = 4000) -> Sweep:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-15, -11, -1.8), (15, 11, 1.0), (count, 3)).astype(np.float32)
    xyz[: count // 2, 2] = -1.8
    return Sweep(xyz, rng.uniform(0, 1, count).astype(np.float32), stamp_ns, Pose.identity())


def _pose(step: int) -> Pose:
    return Pose.from_yaw(0.02 * step, (0.8 * step, 0.0, 0.0))


def _source(file: Path, **settings: object) -> PillarFlow:
    return PillarFlow(PillarFlowConfig(weights=str(file), **settings), grid=GRID)


def test_it_is_a_flow_source_with_a_field_on_the_grid(file: Path) -> None:
    source = _source(file)
    assert isinstance(source, FlowSource)
    field = source.estimate([_sweep(0)], _sweep(100_000_000, 1))
    assert field.grid == GRID
    assert field.occupied.any()
    assert not field.velocity_mps[~field.occupied].any()
    assert not (field.valid & ~field.occupied).any()
    eigenvalues = np.linalg.eigvalsh(field.covariance_m2ps2[field.valid])
    assert (eigenvalues > 0).all()


def test_raw_is_what_estimate_returns_unrefined(file: Path) -> None:
    source = _source(file, refined=False)
    previous, current = _sweep(0), _sweep(100_000_000, 1)
    field = source.estimate([previous], current)
    raw = source.raw(source.stages.before([previous], current))
    assert np.array_equal(field.velocity_mps, raw.velocity_mps)


def test_features_of_the_earlier_sweep_are_reused_to_the_bit(file: Path) -> None:
    drive = [replace(_sweep(k * 100_000_000, k), world_T_ego=_pose(k)) for k in range(3)]
    continued, fresh = _source(file), _source(file)
    continued.estimate([drive[0]], drive[1])
    image = continued.stages.features_of(drive[1]).image
    one, two = continued.estimate([drive[1]], drive[2]), fresh.estimate([drive[1]], drive[2])
    assert continued.stages.features_of(drive[1]).image is image
    assert np.array_equal(one.velocity_mps, two.velocity_mps)
    assert np.array_equal(one.covariance_m2ps2, two.covariance_m2ps2)
    assert np.array_equal(one.valid, two.valid)
    continued.reset()
    assert continued.stages.features_of(drive[1]).image is not image


def test_a_network_of_two_sweeps_compares_over_the_longer_baseline_unless_traffic_is_fast(
    file: Path,
) -> None:
    """Ages in milliseconds, from the oldest on; the oldest is for the refinement."""

    def ages_ms(source: PillarFlow, step_m: float) -> list[int]:
        *past, now = (
            replace(_sweep(k * 100_000_000), world_T_ego=Pose.from_yaw(0.0, (step_m * k, 0, 0)))
            for k in range(6)
        )
        return [(now.stamp_ns - s.stamp_ns) // 1_000_000 for s in source.in_use(past, now)]

    assert ages_ms(_source(file), 0.5) == [500, 200]
    assert ages_ms(_source(file), 2.5) == [500, 100]
    assert ages_ms(_source(file, refined=False), 0.5) == [200]
    assert ages_ms(_source(file, baseline_s=0.1), 0.5) == [500, 100]


def test_a_past_of_several_sweeps_is_prepared_sweep_by_sweep(file: Path) -> None:
    """Each as the earlier one of a pair of its own; a network of two sweeps takes that of 0.2 s."""
    drive = [replace(_sweep(k * 100_000_000, k), world_T_ego=_pose(k)) for k in range(4)]
    source = _source(file, refined=False)
    pair = source.stages.before(drive[:3], drive[3])
    assert len(pair.past) == 3
    for sweep, past in zip(drive[:3], pair.past, strict=True):
        alone = source.stages.before([sweep], drive[3]).past[0]
        assert np.array_equal(past.obstacles.xyz_m, alone.obstacles.xyz_m)
        assert past.elapsed_s == pytest.approx((drive[3].stamp_ns - sweep.stamp_ns) * 1e-9)
    one, two = source.estimate(drive[:3], drive[3]), source.estimate(drive[1:2], drive[3])
    assert np.array_equal(one.velocity_mps, two.velocity_mps)


def test_older_sweeps_are_given_to_a_network_that_takes_them(tmp_path: Path) -> None:
    """Each in its slot, with the ratio of the times; one that is not there is marked, not zero."""
    path = tmp_path / "history.safetensors"
    save_weights(path, _weights(TINY_HISTORY))
    source = _source(path, refined=False)
    drive = [replace(_sweep(k * 100_000_000, k), world_T_ego=_pose(k)) for k in range(6)]

    def ratios(*ages: int) -> list[float]:
        pair = source.stages.before([drive[5 - age] for age in ages], drive[5])
        given = source.engine_input(pair)
        for one in given.older:
            age = round(1 / one.ratio) if one.ratio else None
            alone = age and source.stages.before([drive[5 - age]], drive[5]).previous
            assert len(one.points) == (len(alone) if alone else 0)
        return [round(one.ratio, 3) for one in given.older]

    assert ratios(5, 3, 1) == [0.333, 0.2]
    assert ratios(5, 1) == [0.0, 0.2]
    assert ratios(4, 2, 1) == [0.5, 0.25]
    assert ratios(1) == []
    whole, pair = source.estimate(drive[:5], drive[5]), source.estimate([drive[3]], drive[5])
    stamps = [one.stamp_ns for one in source.in_use(drive[:5], drive[5])]
    assert stamps == [drive[i].stamp_ns for i in (0, 2, 3)]
    assert not np.array_equal(whole.velocity_mps, pair.velocity_mps)
    alone = _source(path, refined=False, sweeps=2).estimate(drive[:5], drive[5])
    assert np.array_equal(alone.velocity_mps, pair.velocity_mps)


def test_absent_older_sweeps_are_as_if_there_were_none() -> None:
    network = _weights(TINY_HISTORY).network
    generator = torch.Generator().manual_seed(1)
    images = [torch.rand(1, 8, 32, 32, generator=generator) for _ in range(4)]
    shares = torch.rand(1, 8, 32, 32, generator=generator)
    none = network.flow(*images[:2], shares)
    absent = network.flow(*images[:2], shares, torch.cat(images[2:], 1), torch.zeros(1, 2))
    assert torch.allclose(none.motions[-1], absent.motions[-1], atol=1e-6)


def test_half_the_time_is_twice_the_velocity(file: Path) -> None:
    source = _source(file, refined=False)
    slow = source.estimate([_sweep(0)], _sweep(100_000_000, 1))
    fast = source.estimate([_sweep(0)], _sweep(50_000_000, 1))
    assert np.allclose(2 * slow.velocity_mps, fast.velocity_mps, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("config", [TINY, TINY_HISTORY], ids=["two sweeps", "four"])
def test_folded_inference_equals_the_trained_network(config: NetworkConfig) -> None:
    weights, cells = _weights(config), CellGrid(-16.0, -16.0, 0.5, 64, 64)
    rng = np.random.default_rng(0)
    sweeps = [
        rng.uniform((-16, -16, 0.3, 0), (16, 16, 2.5, 1), (900, 4)).astype(np.float32)
        for _ in range(4)
    ]
    shares = rng.uniform(0, 1, (8, 64, 64)).astype(np.float32)
    older = (OlderPoints(sweeps[2], 0.1 / 0.3), OlderPoints(sweeps[3], 0.1 / 0.5))
    given = EngineInput(sweeps[0], sweeps[1], shares, older[: weights.network.config.older])
    motion = CpuEngine(weights).run(given, cells)
    described = [describe(points, cells) for points in sweeps]
    points = [
        PointBatch(torch.from_numpy(one.descriptors), torch.from_numpy(one.cells), 1, 64, 64)
        for one in described
    ]
    ratio = torch.tensor([[0.1 / 0.3, 0.1 / 0.5]])
    with torch.no_grad():
        estimate = weights.network(
            NetworkInput(*points[:2], torch.from_numpy(shares)[None], tuple(points[2:]), ratio)
        )
    wanted = estimate.motions[-1][0].permute(1, 2, 0).numpy()
    assert np.abs(wanted).max() > 0.05
    assert np.allclose(motion.motion_m, wanted, atol=1e-5)


@pytest.mark.parametrize("count", [0, 1])
def test_a_nearly_empty_sweep_gives_a_defined_field(file: Path, count: int) -> None:
    source, some = _source(file), _sweep(100_000_000, 1)
    little = replace(_sweep(0), xyz_m=some.xyz_m[:count], reflectance=some.reflectance[:count])
    field = source.estimate([little], some)
    assert field.occupied.any()
    assert count or not field.valid.any()
    late = replace(little, stamp_ns=200_000_000)
    field = source.estimate([some], late)
    assert field.occupied.sum() <= count
    both = source.estimate([little], late)
    assert np.isfinite(both.velocity_mps).all()


def test_wrong_order_a_gap_and_nan(file: Path) -> None:
    source, sweep = _source(file), _sweep(5)
    for stamp_ns in (5, 4):
        with pytest.raises(InputError, match="stamp_ns"):
            source.estimate([sweep], _sweep(stamp_ns, 1))
    gap = source.estimate([sweep], _sweep(3_000_000_005, 1))
    assert gap.occupied.any()
    assert not gap.valid.any()
    with pytest.raises(InputError, match="xyz_m"):
        replace(sweep, xyz_m=np.full_like(sweep.xyz_m, np.nan))


def test_unusable_weights_are_named(file: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="absent"):
        _source(tmp_path / "none.safetensors")
    with pytest.raises(DataError, match=r"one of \["):
        PillarFlow(PillarFlowConfig(weights="of_another_project"))
    torn = tmp_path / "torn.safetensors"
    torn.write_bytes(file.read_bytes()[:-100])
    foreign = tmp_path / "foreign.safetensors"
    save_file({"a": torch.zeros(2)}, foreign)
    text = tmp_path / "text.safetensors"
    text.write_text("hello")
    shaped = tmp_path / "shaped.safetensors"
    weights = _weights()
    weights.network.encoder.linear.weight = torch.nn.Parameter(torch.zeros(9, 9))
    save_weights(shaped, weights)
    assert shaped.stat().st_mode & 0o444 == 0o444  # others of the machine can read them
    infinite = tmp_path / "infinite.safetensors"
    weights = _weights()
    weights.network.encoder.linear.weight.data[0, 0] = torch.inf
    save_weights(infinite, weights)
    for bad in (torn, foreign, text, shaped, infinite):
        with pytest.raises(DataError, match=bad.name):
            load_weights(bad)


def _rewritten(file: Path, edit) -> Path:
    """Change the header of a safetensors file, which is JSON after its length."""
    data = file.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = edit(data[8 : 8 + length].decode()).encode()
    out = file.with_name("rewritten.safetensors")
    out.write_bytes(len(header).to_bytes(8, "little") + header + data[8 + length :])
    return out


def test_weights_are_checked_before_anything_is_built(tmp_path: Path) -> None:
    file = tmp_path / "small.safetensors"
    save_weights(file, _weights())
    assert load_weights(file).network is not None
    began = time.process_time()
    layers = re.compile(r'convs_per_level\\":\d+')
    for edit, message in (
        (lambda h: layers.sub('convs_per_level\\":1000000000', h), "convs_per_level"),
        (lambda h: layers.sub('convs_per_level\\":9', h), "tensors is differing"),
        (lambda h: h.replace('"F32"', '"I32"', 1), "I32 .*expected F32"),
        (
            lambda h: re.sub(r'"sha256":"[0-9a-f]{8}', '"sha256":"00000000', h),
            "checksum is 00000000",
        ),
    ):
        with pytest.raises(DataError, match=message):
            load_weights(_rewritten(file, edit))
    assert time.process_time() - began < 5.0
    for place in (-5, -4000):
        data = bytearray(file.read_bytes())
        data[place] ^= 2
        (tmp_path / "flipped.safetensors").write_bytes(bytes(data))
        with pytest.raises(DataError, match=r"flipped\.safetensors: "):
            load_weights(tmp_path / "flipped.safetensors")


def test_a_shipped_file_is_the_one_that_was_packed(tmp_path: Path) -> None:
    for name in ("pwc.safetensors", "SHA256SUMS"):
        (tmp_path / name).write_bytes((SHIPPED / name).read_bytes())
    load_weights(tmp_path / "pwc.safetensors")
    data = bytearray((SHIPPED / "pwc.safetensors").read_bytes())
    data[-2] ^= 1
    (tmp_path / "pwc.safetensors").write_bytes(bytes(data))
    with pytest.raises(DataError, match=r"pwc\.safetensors: checksum is .* .damaged"):
        load_weights(tmp_path / "pwc.safetensors")


def test_binary_network_runs_behind_the_same_interface(tmp_path: Path) -> None:
    path = tmp_path / "binary.safetensors"
    save_weights(path, _weights(PRESETS["binary_ogm"]))
    source = BinaryOgmFlow(BinaryOgmConfig(weights=str(path)), grid=GRID)
    field = source.estimate([_sweep(0)], _sweep(100_000_000, 1))
    assert field.occupied.any()


@pytest.mark.parametrize("network", [TINY, TINY_HISTORY], ids=["two sweeps", "four"])
@pytest.mark.parametrize("backbone", DECODERS)
def test_export_agrees_with_onnxruntime(
    tmp_path: Path, backbone: str, network: NetworkConfig
) -> None:
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    config = network.model_copy(update={"backbone": backbone})
    cells = CellGrid(-16.0, -16.0, 0.5, 64, 64)
    worst_m = export_onnx(_weights(config), tmp_path / "net.onnx", cells)
    assert worst_m < 1e-4


def test_the_context_network_of_the_paper_has_relu() -> None:
    """Section III-B; the shipped networks were trained with PWC-Net's LeakyReLU."""
    torch.manual_seed(0)
    features, motion = torch.randn(1, 5, 8, 8), torch.zeros(1, 2, 8, 8)
    for config in (PRESETS["paper"], PRESETS["base"]):
        context = Context(config, inputs=5).eval()
        least = context(features, motion)[1].min().item()
        assert (least == 0.0) == (config is PRESETS["paper"])


def test_labels_follow_a_turning_box() -> None:
    def truth(stamp_ns: int, x_m: float, yaw_rad: float) -> Truth:
        return Truth(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=np.array([[x_m, 0.0, 0.0]]),
            size_m=np.array([[4.0, 2.0, 2.0]]),
            yaw_rad=np.array([yaw_rad]),
            label=np.array(["car"]),
            id=np.array([7]),
            velocity_mps=np.zeros((1, 2)),
            num_points=np.array([1]),
            interpolated=np.array([False]),
        )

    xyz = np.array([[1.5, 0.5, 0.0], [9.0, 0.0, 0.0]], np.float32)
    now = Sweep(xyz, np.zeros(2, np.float32), 100_000_000, Pose.identity())
    then = replace(now, stamp_ns=0, xyz_m=xyz - np.float32(0.5))
    older = replace(now, stamp_ns=-200_000_000, xyz_m=xyz - np.array([3.0, 0, 0], np.float32))
    labels = labels_from_tracks(
        BoxedSweep(then, truth(0, -1.0, 0.0)),
        BoxedSweep(now, truth(100_000_000, 0.0, 0.1)),
        [BoxedSweep(older, truth(-200_000_000, -3.0, -0.2))],
    )
    c, s = np.cos(-0.1), np.sin(-0.1)
    was = np.array([1.5 * c - 0.5 * s - 1.0, 1.5 * s + 0.5 * c])
    assert np.allclose(labels.velocity_mps[0], (xyz[0, :2] - was) / 0.1, atol=1e-4)
    assert not labels.velocity_mps[1].any()
    assert list(labels.current_object) == [0, -1]
    assert np.allclose(labels.centre_m[0], [[-1.0, 0.0], [0.0, 0.0], [-3.0, 0.0]])
    assert list(labels.older_object[0]) == [0, -1]

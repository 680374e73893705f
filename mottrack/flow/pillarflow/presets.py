"""Named networks: three sizes of PillarFlow, the binary rival and two older backbones."""

from __future__ import annotations

from mottrack.core.errors import InputError
from mottrack.flow.pillarflow.config import NetworkConfig

SMALL = NetworkConfig(
    pillar_channels=16,
    stem_stride=2,
    pyramid_channels=(24, 32, 48),
    estimator_channels=(32, 24, 24),
)
BASE = NetworkConfig()
PAPER = NetworkConfig(
    cell_m=0.25,
    pillar_channels=64,
    stem_stride=2,
    pyramid_channels=(16, 32, 64, 96, 128, 196),
    convs_per_level=3,
    finest_level=1,
    displacement=4,
    match_channels=0,
    estimator_channels=(128, 128, 96, 64, 32),
    dense=True,
    upfeat_channels=2,
    context_channels=(128, 128, 128, 96, 64, 32),
    context_dilations=(1, 2, 4, 8, 16, 1),
)
BINARY_OGM = NetworkConfig(encoder="binary", pillar_channels=1, visibility=False)
SPYNET = NetworkConfig(backbone="spynet", pyramid_channels=(24, 24, 24))
FLOWNET = NetworkConfig(backbone="flownet")

PRESETS: dict[str, NetworkConfig] = {
    "small": SMALL,
    "base": BASE,
    "paper": PAPER,
    "binary_ogm": BINARY_OGM,
    "spynet": SPYNET,
    "flownet": FLOWNET,
}


def preset(name: str) -> NetworkConfig:
    """Return the network called `name`; raises InputError that lists the names."""
    if name not in PRESETS:
        raise InputError("network", name, f"one of {', '.join(PRESETS)}")
    return PRESETS[name]

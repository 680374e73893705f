"""The flow networks behind the encoder by name, and the named networks as a whole.

To add a network, write a subclass of `Decoder` and enter it in `DECODERS` and `PRESETS` below; no
other file names one.
"""

from __future__ import annotations

from mottrack.core.errors import InputError
from mottrack.flow.pillarflow.config import NetworkConfig
from mottrack.flow.pillarflow.decoder import Decoder
from mottrack.flow.pillarflow.pwc import PwcDecoder
from mottrack.flow.pillarflow.rivals import FlowNetDecoder, SpyNetDecoder

DECODERS: dict[str, type[Decoder]] = {
    "pwc": PwcDecoder,
    "spynet": SpyNetDecoder,
    "flownet": FlowNetDecoder,
}

PRESETS: dict[str, NetworkConfig] = {
    "small": NetworkConfig(
        pillar_channels=16,
        stem_stride=2,
        pyramid_channels=(24, 32, 48),
        estimator_channels=(32, 24, 24),
    ),
    "base": NetworkConfig(),
    "base_history": NetworkConfig(sight=True, older_ages_s=(0.3, 0.5)),
    "paper": NetworkConfig(
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
        context_slope=0.0,
    ),
    "binary_ogm": NetworkConfig(encoder="binary", pillar_channels=1, visibility=False),
    "spynet": NetworkConfig(backbone="spynet", pyramid_channels=(24, 24, 24)),
    "flownet": NetworkConfig(backbone="flownet"),
}
"""Named networks: three sizes of PillarFlow (`paper` as published), `base` with older sweeps and
three-dimensional visibility, the binary baseline of IV-C and two older backbones."""


def preset(name: str) -> NetworkConfig:
    """Return the network called `name`.

    Raises:
        InputError: there is none of that name; the error lists the valid ones.
    """
    if name not in PRESETS:
        raise InputError("network", name, f"one of {', '.join(PRESETS)}")
    return PRESETS[name]


def make_decoder(config: NetworkConfig, *, inputs: int) -> Decoder:
    """Build the decoder that `config.backbone` names.

    Raises:
        InputError: there is none of that name; the error lists the valid ones.
    """
    if config.backbone not in DECODERS:
        raise InputError("backbone", config.backbone, f"one of {', '.join(DECODERS)}")
    return DECODERS[config.backbone](config, inputs=inputs)

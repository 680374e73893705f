"""Architecture of a PillarFlow network as plain data (paper, section III)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mottrack.config import StrictModel

MOST_CHANNELS, MOST_LAYERS = 1024, 16
"""Ten times the largest network that is shipped or was tried: a file that asks for more is damaged
or hostile."""
MOST_OLDER = 4
"""Each older sweep costs a fifth of the time of the network; more than two were not tried."""
Width = Annotated[int, Field(ge=1, le=MOST_CHANNELS)]
Layers = Annotated[int, Field(ge=1, le=MOST_LAYERS)]
Ages = Annotated[tuple[Annotated[float, Field(gt=0, le=1)], ...], Field(max_length=MOST_OLDER)]
Widths = Annotated[tuple[Width, ...], Field(max_length=MOST_LAYERS)]


class NetworkConfig(StrictModel):
    """Widths, levels and search radii of one network; `decoders.PRESETS` has the shipped ones.

    It is stored in the header of a weights file, so a renamed key makes older weights unreadable.
    Level `l` of the pyramid has cells of `cell_m * stem_stride * 2**l` metres.
    """

    cell_m: float = Field(0.5, gt=0, description="edge of a pillar [m]")
    encoder: Literal["pillars", "binary"] = Field(
        "pillars", description="learned pillars (III-A) or the binary occupancy of IV-C"
    )
    backbone: str = Field("pwc", description="flow network, a key of `decoders.DECODERS`")
    pillar_channels: Width = Field(24, description="C of the pseudo-image")
    stem_stride: Literal[1, 2] = Field(1, description="stride of the first convolution")
    pyramid_channels: Widths = Field((24, 40, 56), description="width of each level")
    convs_per_level: int = Field(
        2, ge=1, le=MOST_LAYERS, description="3x3 convolutions of a pyramid level"
    )
    finest_level: int = Field(0, ge=0, description="finest level that is decoded")
    displacement: int = Field(
        3, ge=1, le=MOST_LAYERS, description="search radius of a cost volume [cells]"
    )
    rest_displacement: int = Field(
        1,
        ge=0,
        le=MOST_LAYERS,
        description="search radius of the second cost volume, around zero motion [cells]",
    )
    match_channels: int = Field(
        16, ge=0, le=MOST_CHANNELS, description="1x1 projection before matching; 0: none"
    )
    estimator_channels: Widths = Field((40, 32, 24), description="flow estimator")
    dense: bool = Field(False, description="DenseNet links inside an estimator (PWC-Net)")
    upfeat_channels: int = Field(
        8, ge=1, le=MOST_CHANNELS, description="features passed to the next finer level"
    )
    context_channels: Widths = Field((24, 24, 24), description="context network")
    context_dilations: Widths = Field((1, 2, 4), description="one per context layer")
    context_slope: float = Field(
        0.1,
        ge=0,
        lt=1,
        description="negative slope of the context network's LeakyReLU; 0: ReLU, as in III-B",
    )
    visibility: bool = Field(True, description="visibility of both sweeps as channels")
    sight: bool = Field(
        False,
        description="share of a cell's points that the other sweep could not see, and saw through",
    )
    older_ages_s: Ages = Field(
        (),
        description="ages of older sweeps that refine the finest displacement: the first is matched"
        " along the extrapolated motion, the others around rest",
    )
    older_displacement: int = Field(
        2, ge=1, le=MOST_LAYERS, description="search radius of their cost volumes [cells]"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        layers, dilations = len(self.context_channels), len(self.context_dilations)
        if dilations != layers:
            raise ValueError(
                f"context_dilations has {dilations} numbers, expected {layers}, one for each of "
                "context_channels"
            )
        if self.finest_level >= self.levels:
            raise ValueError(
                f"finest_level is {self.finest_level}, expected less than {self.levels}, the "
                "number of pyramid_channels"
            )
        return self

    @property
    def levels(self) -> int:
        """Number of pyramid levels."""
        return len(self.pyramid_channels)

    @property
    def strides(self) -> tuple[int, ...]:
        """Stride of each level in pillars, finest first."""
        return tuple(self.stem_stride * 2**level for level in range(self.levels))

    @property
    def output_stride(self) -> int:
        """Stride of the flow that leaves the network, in pillars."""
        return self.strides[self.finest_level]

    @property
    def image_shares(self) -> int:
        """Number of channels beside the pseudo-image of a sweep."""
        return 2 * self.visibility + 2 * self.sight

    @property
    def told_shares(self) -> int:
        """Number of these channels that estimators get: 2-D of the previous sweep, 3-D of both."""
        return 2 * self.visibility + 4 * self.sight

    @property
    def older(self) -> int:
        """Number of older sweeps."""
        return len(self.older_ages_s)

    @property
    def image_channels(self) -> int:
        """Number of channels of the pseudo-image that the encoder makes."""
        return self.pillar_channels if self.encoder == "pillars" else 1

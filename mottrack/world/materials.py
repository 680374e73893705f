"""What a beam does when it meets a thing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Mask

(
    PLAIN,
    PAINT,
    GLASS,
    FOLIAGE,
    HEDGE,
    FENCE,
    FACADE,
    SIGN,
    CLOTH,
    FRAME,
    ASPHALT,
    CONCRETE,
    GRASS,
    SHOPFRONT,
) = range(14)


class Materials(NamedTuple):
    """Table of M materials, named tuple of arrays for numba."""

    opacity: F64
    """(M,) share of beams that the outer surface sends back."""
    density_per_m: F64
    """(M,) inside, the rate of the exponential free path of beams that got in."""
    clumped: Mask
    """(M,) whether the density inside varies from place to place, as leaves do."""
    window_pitch_m: F64
    """(M,) distance of the windows of a facade; 0: none."""
    window_share: F64
    """(M,) width of a window over the pitch."""
    mirror: F64
    """(M,) share of beams lost by mirroring, most of all at a slant."""
    speckle: F64
    """(M,) relative spread of the reflectance from point to point."""


def material_table() -> Materials:
    """The materials of the embedded world, in the order of the names of this module."""
    rows = np.array(
        [
            # opacity density clumped pitch share mirror speckle
            [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.25],  # PLAIN
            [0.99, 0.0, 0, 0.0, 0.0, 0.12, 0.35],  # PAINT
            [0.35, 0.5, 0, 0.0, 0.0, 0.25, 0.50],  # GLASS
            [0.00, 1.1, 1, 0.0, 0.0, 0.00, 0.50],  # FOLIAGE
            [0.25, 4.0, 1, 0.0, 0.0, 0.00, 0.45],  # HEDGE
            [0.28, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # FENCE
            [1.00, 0.0, 0, 2.6, 0.5, 0.00, 0.20],  # FACADE
            [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.05],  # SIGN
            [0.98, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # CLOTH
            [0.45, 0.0, 0, 0.0, 0.0, 0.10, 0.50],  # FRAME
            [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.35],  # ASPHALT
            [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.25],  # CONCRETE
            [1.00, 0.0, 0, 0.0, 0.0, 0.00, 0.50],  # GRASS
            [1.00, 0.0, 0, 3.2, 0.8, 0.00, 0.25],  # SHOPFRONT
        ]
    )
    return Materials(
        opacity=rows[:, 0].copy(),
        density_per_m=rows[:, 1].copy(),
        clumped=rows[:, 2] > 0,
        window_pitch_m=rows[:, 3].copy(),
        window_share=rows[:, 4].copy(),
        mirror=rows[:, 5].copy(),
        speckle=rows[:, 6].copy(),
    )

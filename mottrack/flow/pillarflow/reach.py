"""How far a network can look: correlation reach and receptive field (paper, section III-B).

"We adjust architecture parameters such as receptive field and correlation layer parameters to
account for the maximum relative motion that would be expected": 35 m/s at 10 Hz is 3.5 m between
two sweeps once ego motion is removed, 7 cells of 0.5 m. A cost volume of reach d at a level of
stride s covers d * s cells, and the levels add up, since each starts from the one before.
"""

from __future__ import annotations

from mottrack.core.errors import InputError
from mottrack.flow.pillarflow.config import NetworkConfig


def reach_m(config: NetworkConfig) -> float:
    """Largest motion along an axis that the matching can find [m]."""
    if config.backbone == "spynet":
        per_level = 3.0  # a 7x7 kernel sees three cells to each side of the warped image
        return config.cell_m * per_level * sum(config.strides)
    if config.backbone == "flownet":
        return config.cell_m * 3 * config.strides[2]
    levels = config.strides[config.finest_level :]
    return config.cell_m * config.displacement * sum(levels)


def pyramid_field_cells(config: NetworkConfig) -> int:
    """Edge of the square of pillars that one coarsest feature depends on."""
    field, step = 1, 1
    for level in range(config.levels):
        stride = config.stem_stride if level == 0 else 2
        field += 2 * step
        step *= stride
        field += 2 * step * (config.convs_per_level - 1)
    return field


def receptive_field_m(config: NetworkConfig) -> float:
    """Edge of the square of ground that one coarsest feature depends on [m].

    SpyNet has no pyramid of features: its coarsest stack sees 7x7 kernels on pooled images.
    """
    if config.backbone == "spynet":
        return config.cell_m * config.strides[-1] * (1 + 5 * 6)
    return config.cell_m * pyramid_field_cells(config)


def check_reach(config: NetworkConfig, *, speed_mps: float, elapsed_s: float) -> None:
    """Raise InputError if an object this fast leaves the reach or the field within `elapsed_s`."""
    wanted_m, field_m = speed_mps * elapsed_s, receptive_field_m(config)
    if wanted_m > reach_m(config):
        raise InputError("reach", f"{reach_m(config)} m", f">= {wanted_m} m")
    if 2 * wanted_m > field_m:
        raise InputError("receptive field", f"{field_m} m", f">= {2 * wanted_m} m")

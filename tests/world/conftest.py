from __future__ import annotations

import pytest

from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset, SyntheticScene


@pytest.fixture(scope="session")
def scenes() -> list[SyntheticScene]:
    """One short scene of each kind of place, built once."""
    return [
        dataset.scene(dataset.scene_names[0])
        for dataset in (
            SyntheticDataset(SyntheticConfig(scenes=1, seed=11, duration_s=4.0, place=place))
            for place in ("urban", "residential", "motorway")
        )
    ]

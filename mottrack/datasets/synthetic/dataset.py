"""The embedded world as a data set."""

from __future__ import annotations

from mottrack.core.errors import ConfigError, unknown_name
from mottrack.datasets.synthetic.config import SyntheticConfig
from mottrack.datasets.synthetic.scene import SyntheticScene, scene_name
from mottrack.world.sensor import sensor_model


class SyntheticDataset:
    """Procedural driving scenes, from one seed, bit-identical on every run.

    Raises:
        ConfigError: the sensor is unknown, or key frames do not fall on sweeps.
    """

    Config = SyntheticConfig

    def __init__(self, config: SyntheticConfig | None = None) -> None:
        self._config = config or SyntheticConfig()
        if self._config.sensor != "random":
            sensor_model(self._config.sensor)
        if self._config.sweep_hz % self._config.key_hz:
            raise ConfigError(
                f"key_hz is {self._config.key_hz}, expected a divisor of sweep_hz "
                f"({self._config.sweep_hz})"
            )

    @property
    def name(self) -> str:
        """``synthetic``."""
        return "synthetic"

    @property
    def scene_names(self) -> tuple[str, ...]:
        """``synthetic-s<seed>-<number>`` for each number from ``first_scene`` on."""
        first, seed = self._config.first_scene, self._config.seed
        return tuple(scene_name(seed, first + k) for k in range(self._config.scenes))

    def scene(self, name: str) -> SyntheticScene:
        """Open one scene; its world is built when first asked for.

        Raises:
            ConfigError: no scene has that name.
        """
        if name not in self.scene_names:
            raise unknown_name("scene", name, self.scene_names)
        return SyntheticScene(self._config, int(name.rsplit("-", 1)[1]))

"""Where and how runs are executed, from the options of the command line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mottrack.pipeline.flow_cache import FlowCache
    from mottrack.runs.runner import Execution
    from mottrack.runs.tasks import Executor

WRITERS = ("driver", "shared")
GB = 1e9


def flow_cache(most_gb: float) -> FlowCache:
    """Return the user's folder of flow fields, with a greatest size."""
    from mottrack.formats.cache import cache_folder
    from mottrack.pipeline.flow_cache import FlowCache

    return FlowCache(cache_folder() / "flow", int(GB * most_gb))


@dataclass(frozen=True)
class Where:
    """The options of commands with many scenes on the machines that do the work."""

    workers: int = 0
    cluster: str | None = None
    results: str = "driver"
    shard: str | None = None
    cache_gb: float = 0.0

    def execution(self) -> Execution:
        """Return the execution that the options ask for.

        Raises:
            ConfigError: the shard is not I/N, or results are written by neither.
        """
        from mottrack.runs.runner import Execution
        from mottrack.runs.shard import Shard

        shard = Shard() if self.shard is None else Shard.parse(self.shard)
        cache = flow_cache(self.cache_gb) if self.cache_gb else None
        return Execution(self._executor(), shard, cache=cache)

    def _executor(self) -> Executor:
        from mottrack.core.errors import unknown_name
        from mottrack.runs.local_pool import LocalPool
        from mottrack.runs.ray_cluster import RayCluster

        if self.results not in WRITERS:
            raise unknown_name("--results", self.results, WRITERS)
        if self.cluster is None:
            return LocalPool(self.workers)
        return RayCluster(self.cluster, self.workers, shared=self.results == "shared")

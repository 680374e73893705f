"""Connection to a Ray cluster, and what its workers are started with."""

from __future__ import annotations

import os
import socket
import sys
from typing import Any

from mottrack.core.errors import ConfigError
from mottrack.core.processes import available_cores
from mottrack.runs.tasks import THREAD_VARIABLES

LOCAL = "ray"
"""The address that stands for a cluster of this machine alone."""
CONNECT_S = 10.0
"""A machine that lives answers within a second, in a cloud far away too."""


def connected(address: str, workers: int) -> Any:
    """Return Ray, connected.

    Args:
        address: of the cluster, or `LOCAL`.
        workers: CPUs of a cluster of this machine alone; 0: all.

    Raises:
        ConfigError: Ray is not installed, or there is no cluster.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
        import ray.util.scheduling_strategies
    except ImportError as error:
        raise ConfigError(f"--cluster needs Ray: pip install 'mottrack[ray]' ({error})") from error
    if not ray.is_initialized():
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
        try:
            if address == LOCAL:
                cpus = workers or available_cores()
                ray.init("local", num_cpus=cpus, include_dashboard=False, **quiet)
            else:
                _require_answer(address)
                ray.init(address, **quiet)
        except (OSError, RuntimeError, ValueError) as error:
            first = str(error).partition("\n")[0]
            raise ConfigError(f"no Ray cluster at {address}: {first}") from error
    return ray


def disconnect() -> None:
    """Leave the cluster; one of this machine alone ends, and its workers' memory is free."""
    ray = sys.modules.get("ray")
    if ray is not None and ray.is_initialized():
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Connect to ``HOST:PORT`` and hang up: Ray itself waits for minutes where nobody answers.

    Raises:
        OSError: nobody answers.
        ValueError: the port is no number.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host:  # else it is "auto"
        socket.create_connection((host, int(port)), timeout=CONNECT_S).close()


def worker_environment() -> dict[str, Any]:
    """Return Ray's runtime environment of a worker: one thread, and the driver's own modules.

    Plug-ins are found on a node where they lie at the same place as here.
    """
    installed = (sys.prefix, sys.base_prefix)
    own = [path for path in sys.path if path and not path.startswith(installed)]
    variables = dict.fromkeys(THREAD_VARIABLES, "1")
    return {"env_vars": {**variables, "PYTHONPATH": os.pathsep.join(own)}}

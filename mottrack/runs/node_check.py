"""What a machine must have in common with the driver before it may run tasks."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mottrack.core.errors import ConfigError, MottrackError
from mottrack.runs.tasks import Job


class Expected(NamedTuple):
    """What the driver found for one job."""

    job: Job
    fingerprint: Mapping[str, str]
    scenes: tuple[str, ...]


@dataclass(frozen=True)
class Requirements:
    """What every node is checked for."""

    jobs: tuple[Expected, ...]
    token: Path | None = None
    """A file that the driver has written into the folder of results; None where none is shared."""

    @classmethod
    def of(cls, scenes: Mapping[Job, tuple[str, ...]], token: Path | None) -> Requirements:
        """Gather what this machine has.

        Raises:
            DataError: a file of weights is missing.
        """
        jobs = (Expected(job, job.fingerprint(), names) for job, names in scenes.items())
        return cls(tuple(jobs), token)

    def unmet(self) -> str:
        """Return what this machine lacks, in a line; empty where it lacks nothing."""
        if self.token is not None and not self.token.exists():
            folder = self.token.parent
            return f"{folder} is not the driver's folder of results; use --results driver"
        for expected in self.jobs:
            try:
                differs = _difference(expected)
            except MottrackError as error:
                return str(error)
            if differs:
                return differs
        return ""


def _difference(expected: Expected) -> str:
    mine, drivers = expected.job.fingerprint(), expected.fingerprint
    other = [what for what in drivers if mine.get(what) != drivers[what]]
    if other:
        return f"another {', another '.join(other)} than the driver's"
    there = expected.job.scenes()
    if there != expected.scenes:
        absent = [scene for scene in expected.scenes if scene not in there]
        return f"{len(there)} scenes, expected the driver's {len(expected.scenes)}" + (
            f"; without {absent[0]}" if absent else ""
        )
    return ""


def require_met(unmet: Sequence[tuple[str, str]]) -> None:
    """Refuse the work where a node lacks something.

    Args:
        unmet: name of a node, and what it lacks or nothing.

    Raises:
        ConfigError: with the names of the nodes, and what the first one lacks.
    """
    faults = [(node, text) for node, text in unmet if text]
    if faults:
        others = f" (and {len(faults) - 1} more nodes)" if len(faults) > 1 else ""
        raise ConfigError(f"node {faults[0][0]}{others}: {faults[0][1]}")


def node_name(node_id: str) -> str:
    """Return a name of this machine's part of the cluster: host, and the start of Ray's id."""
    return f"{platform.node()}/{node_id[:6]}"

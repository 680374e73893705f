"""Configurations of the runs: what differs between them, and what they share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from mottrack.report.ranking import ReportRun

ABSENT = "–"


class Setting(NamedTuple):
    """A key and its value in every run, in their order."""

    key: str
    values: tuple[str, ...]


def differing(runs: Sequence[ReportRun]) -> list[Setting]:
    """Return the keys whose values are not the same in all runs; those of a run alone too."""
    flat = [dict(_flat(run.scored.experiment.resolved(), "")) for run in runs]
    keys = dict.fromkeys(key for one in flat for key in one)
    rows = [Setting(key, tuple(one.get(key, ABSENT) for one in flat)) for key in keys]
    return [row for row in rows if len(set(row.values)) > 1]


def _flat(tree: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, str]]:
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", "null" if value is None else str(value)

"""Runs of a comparison that gave the same tracks, such as those whose tracker ignores the flow."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence

from mottrack.runs.scored_run import ScoredRun
from mottrack.trackers.kalman.config import KalmanConfig


def equal_runs(runs: Sequence[ScoredRun]) -> dict[str, str]:
    """Return the title of each run whose tracks are those of an earlier one, and of that one.

    Tracks are equal if every column is, to the bit, in every finished scene. A run that was given
    the truth equals no other: it is named apart.

    Raises:
        ResultError: a stored result is damaged.
    """
    first: dict[tuple[object, ...], str] = {}
    equal: dict[str, str] = {}
    for run in runs:
        if run.finished:
            key = run.dataset, run.given_truth, run.finished, _digest(run)
            title = first.setdefault(key, run.title)
            if title != run.title:
                equal[run.title] = title
    return equal


def _digest(run: ScoredRun) -> bytes:
    digest = hashlib.sha256()
    for scene in run.finished:
        tracks = run.folder.load(scene, flow=False).tracks
        for name in type(tracks).COLUMNS:
            digest.update(getattr(tracks, name).tobytes())
    return digest.digest()


def told(runs: Sequence[ScoredRun], equal: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each run that others equal, with the reason where it is known."""
    by_title = {run.title: run for run in runs}
    for title in dict.fromkeys(equal.values()):
        others = ", ".join(name for name, same in equal.items() if same == title)
        config = by_title[title].experiment.tracker.config
        ignored = isinstance(config, KalmanConfig) and not config.velocity.use
        reason = "; its tracker ignores measured velocities (velocity.use: false)"
        yield f"the tracks of {others} equal those of {title}{reason if ignored else ''}"

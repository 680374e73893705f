"""Warnings about data on standard error, and the exit code that tells of them."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from mottrack.core.concerns import Concern, ConcernError

EXIT_FAULTS = 3
"""The command did its work, but on data that has faults or is hardly meant."""


def warn_of(concerns: Sequence[Concern], *, strict: bool) -> None:
    """Print a line for each concern; if strict, raise `ConcernError` with all of them instead."""
    if strict and concerns:
        raise ConcernError(concerns)
    for concern in concerns:
        typer.echo(f"warning: {concern}", err=True)


def exit_with_warnings(concerns: Sequence[object]) -> None:
    """End the command with `EXIT_FAULTS` if there was a warning."""
    if concerns:
        raise typer.Exit(EXIT_FAULTS)

"""``mottrack warm``."""

from __future__ import annotations

import typer


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("warm")(warm)


def warm() -> None:
    """Compile now what the first run would compile; it is kept for all later ones.

    Short scenes of the embedded world are run with every flow source and tracker. Nothing is
    written but the compiled functions.

    Example: mottrack warm
    """
    from mottrack.compiled import COMPILING_S
    from mottrack.runs.warm import STEPS, kept_in
    from mottrack.runs.warm import warm as steps

    typer.echo(f"compiling, once for this installation: about {COMPILING_S:.0f} s of CPU time")
    done = []
    for step in steps():
        done.append(step)
        count = f"{len(done)}/{len(STEPS)}"
        typer.echo(f"{count} {step.what}: {step.functions} functions, {step.cpu_s:.1f} s")
    total = sum(step.functions for step in done)
    place = kept_in()
    if place is None:
        typer.echo("no folder can be written, so each process compiles again (NUMBA_CACHE_DIR)")
    elif total:
        typer.echo(f"{total} functions compiled and kept beside the package: {place.parent}")
    else:
        typer.echo("nothing was left to compile")

"""The command line: each module registers a group of commands; heavy imports wait for their use."""

from __future__ import annotations

import io
import sys
from typing import Annotated

import typer

from mottrack.cli import (
    adapt,
    configs,
    convert,
    data,
    eval,
    exchange,
    folds,
    machines,
    noise,
    paper,
    report,
    run,
    stress,
    train,
    tune,
    view,
    warm,
)
from mottrack.cli.arguments import EXIT_USER_ERROR, FullHelpGroup

app = typer.Typer(
    name="mottrack",
    cls=FullHelpGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help starts in half the time
    help="Multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.",
)


def _version(asked: bool) -> None:
    if asked:
        from mottrack._version import __version__

        typer.echo(f"mottrack {__version__}")
        raise typer.Exit


@app.callback(epilog="Example: mottrack demo --quick")
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    pass


GROUPS = (
    run,
    configs,
    warm,
    machines,
    exchange,
    report,
    paper,
    view,
    eval,
    data,
    convert,
    train,
    adapt,
    noise,
    stress,
    tune,
    folds,
)
"""In the order of the help."""
for group in GROUPS:
    group.register(app)


def main() -> None:
    """Run a command; print an error that the user can fix in one line, with exit code 2.

    Errors of the file system are such: a full disk, a folder without permission to write.
    """
    from mottrack.core.errors import MottrackError
    from mottrack.core.memory import exhausted, warn_when_scarce

    for stream in (sys.stdout, sys.stderr):  # a terminal may not have every letter of a name
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    warn_when_scarce()
    try:
        app()
    except MottrackError as error:
        _fail(str(error))
    except MemoryError:
        _fail(exhausted())
    except BrokenPipeError:  # the reader of the output has closed it: `mottrack ... | head`
        sys.stderr.close()
        sys.exit(EXIT_USER_ERROR)
    except OSError as error:
        place = "" if error.filename is None else f"{error.filename}: "
        _fail(f"{place}{error.strerror or type(error).__name__}")


def _fail(message: str) -> None:
    sys.stderr.write(f"mottrack: {message}\n")
    sys.exit(EXIT_USER_ERROR)

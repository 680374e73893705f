"""The command line: each module registers a group of commands; heavy imports wait for their use."""

from __future__ import annotations

import io
import sys

import typer

from mottrack.cli import (
    convert,
    data,
    eval,
    exchange,
    machines,
    noise,
    paper,
    report,
    run,
    stress,
    train,
    tune,
    view,
)
from mottrack.cli.arguments import EXIT_USER_ERROR

app = typer.Typer(
    name="mottrack",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help starts in half the time
    help="Multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.",
)
for group in (
    run,
    machines,
    exchange,
    report,
    paper,
    view,
    eval,
    data,
    convert,
    train,
    noise,
    stress,
    tune,
):
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
